"""Communication steps that choose themselves."""

import itertools
import json
import time
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.fmu.fmu_instance import SHORTER
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.march import UNBOUNDED, LoopRun
from ballscrew.orchestration.master.step_choice import choose_step, only_step
from ballscrew.orchestration.master.verdict import Verdict


def made_up(step: float, values: np.ndarray, trusted: bool, stopped: str = "") -> LoopRun:
    time = np.linspace(0.0, 1.0, len(values))
    return LoopRun(
        time=time,
        outputs={"x": values},
        commands={},
        reference=np.zeros(len(values)),
        coupling=Coupling.JACOBI,
        coupling_reason="",
        corrected=False,
        residual_max={},
        effect_rate_max={},
        macro_steps=len(values) - 1,
        step_range=(step, step),
        verdict=Verdict(trusted, "its own", UNBOUNDED),
        stopped=stopped,
    )


def with_error(error):
    """Runs of x = t whose error is a function of the step, without a verdict of their own."""

    def run_at(step: float, _again) -> LoopRun:
        time = np.linspace(0.0, 1.0, 201)
        return made_up(step, time + error(step) * np.sin(np.pi * time), False)

    return run_at


@pytest.mark.parametrize("order", [1, 2])
def test_halvings_that_converge_are_trusted_and_bound_the_error(order: int) -> None:
    def error(step: float) -> float:
        return 0.2 * (step / 1e-3) ** order

    run, choice = choose_step(with_error(error))
    assert run.verdict.trusted
    assert "halving the step" in run.verdict.reason
    assert error(choice.step) <= run.verdict.error_estimate["x"] * (1 + 1e-9)
    assert run.verdict.error_estimate["x"] <= 0.01 * 1.2


@pytest.mark.parametrize(("ratio", "number"), [(0.69, 9), (0.71, 12)])
def test_each_halving_must_move_less_than_seven_tenths_of_the_last(ratio, number) -> None:
    """Then all to come is a geometric series, which is the estimate of the last run."""
    moved = 0.05 * ratio ** np.arange(12)
    errors = iter(np.cumsum([0.0, *moved]))
    run, choice = choose_step(with_error(lambda _h: next(errors)))
    assert len(choice.tried) == number
    assert run.verdict.trusted == (ratio < 0.7)
    assert choice.step == 1e-3 / 2 ** (number - 1)
    if run.verdict.trusted:
        to_come = ratio / (1 - ratio)
        assert run.verdict.error_estimate["x"] == pytest.approx(to_come * moved[number - 2])
        assert to_come * moved[number - 2] < 0.01 < to_come * moved[number - 3]
    else:
        assert choice.reason == "the last of 12 tried: 12 steps were tried"


@pytest.mark.parametrize(("apart", "number"), [(0.12, 4), (0.11, 12)])
def test_runs_that_do_not_come_closer_to_each_other_are_given_up(apart, number) -> None:
    errors = itertools.cycle([0.0, apart])
    run, choice = choose_step(with_error(lambda _h: next(errors)))
    assert not run.verdict.trusted
    assert len(choice.tried) == number
    assert ("do not converge" in choice.reason) == (number == 4)
    assert run.verdict.advice


@pytest.mark.parametrize(("end", "number"), [(0.981, 2), (0.979, 12)])
def test_runs_that_end_at_the_same_time_are_not_refined_on(end, number) -> None:
    ends = itertools.chain([1.0], itertools.cycle([end, 1.0]))

    def run_at(step: float, _again) -> LoopRun:
        run = made_up(step, np.arange(3.0), False, "the loop diverges: x exceeds its bound")
        return replace(run, time=run.time * next(ends))

    run, choice = choose_step(run_at)
    assert not run.verdict.trusted
    assert len(choice.tried) == number
    assert ("at the same time: the loop diverges" in choice.reason) == (number == 2)


@pytest.mark.parametrize(
    ("advice", "helps", "stopped", "number"),
    [
        ("mend the FMU", True, "it failed", 1),
        (SHORTER, True, "it failed", 12),
        ("whatever the step", False, "", 1),
    ],
)
def test_what_no_shorter_step_mends_is_not_tried_again(advice, helps, stopped, number) -> None:
    verdict = Verdict(False, "its own", advice, {"x": 1.0}, step_helps=helps)
    _, choice = choose_step(
        lambda h, _: replace(made_up(h, np.arange(3.0), False, stopped), verdict=verdict)
    )
    assert len(choice.tried) == number
    assert (advice in choice.reason) == (number == 1)


def test_a_step_that_makes_too_many_steps_is_only_named() -> None:
    """A run of 120 000 steps, then one of 240 000."""

    def run_at(step: float, _again) -> LoopRun:
        run = made_up(step, np.linspace(0.0, 1.0, 11) * (1 + 100 * step**0.2), False)
        return replace(run, macro_steps=round(120.0 / step))

    run, choice = choose_step(run_at)
    assert len(choice.tried) == 2
    assert "a step of 0.00025 s makes 480000 steps, and at most 400000" in run.verdict.advice
    assert "--step 0.00025" in run.verdict.advice


def test_no_number_depends_on_the_time_that_computing_takes(native, monkeypatch) -> None:
    """On a computer without load, and on one that seems to need 100 s for everything."""
    loop = Loop(str(native("pid_dob")), str(native("plant")), stop=0.2)
    ticks = itertools.count()
    found = []
    for clock in (lambda: 0.0, lambda: 100.0 * next(ticks)):
        for name in ("monotonic", "process_time", "perf_counter", "time"):
            monkeypatch.setattr(time, name, clock)
        result = run_closed_loop(loop)
        found.append((repr(result.run.verdict), result.step_choice.tried, result.run.outputs["x"]))
    monkeypatch.undo()
    assert len(found[0][1]) > 1
    assert found[0][:2] == found[1][:2]
    np.testing.assert_array_equal(found[0][2], found[1][2])


def test_fmus_of_one_step_only_are_told_to_be_made_with_a_shorter_one() -> None:
    run, choice = only_step(made_up(1e-3, np.arange(3.0), False), 1e-3)
    assert (choice.step, choice.tried) == (1e-3, ((1e-3, "not converged"),))
    assert "its FMUs take steps of 0.001 s only" in run.verdict.advice
    assert not run.verdict.step_helps
    fine = made_up(1e-3, np.arange(3.0), True)
    assert only_step(fine, 1e-3)[0] == fine


def test_the_command_says_which_step_was_taken_and_why(native, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    given = ["--set", "controller.sigma0_hat=66967.8", "--set", "controller.sigma1_hat=352"]
    parts = ["--controller", str(native("iol")), "--plant", str(native("plant"))]
    arguments = ["run", *parts, *given, "--stop", "1.5", "--out", str(out)]
    assert main(arguments) == 0
    assert "the first whose run is trusted" in capsys.readouterr().out
    figures = json.loads((out / "metrics.json").read_text())
    assert figures["steps_tried"][0] == [1e-3, "not converged"]
    assert figures["steps_tried"][-1] == [6.25e-5, "trusted"]
    assert main([*arguments, "--step", "1e-3"]) == 1
    assert json.loads((out / "metrics.json").read_text())["step_reason"] == "as asked"


def test_halvings_of_what_jumps_are_looked_at_again() -> None:
    asked = []

    def run_at(step: float, is_open) -> LoopRun:
        values = np.linspace(0.0, 1.0, 11) * (1 + 0.2 * step / 1e-3) + (np.arange(11) > 5)
        run = made_up(step, values, False)
        asked.append((step, is_open(run)))
        return run

    choose_step(run_at)
    assert asked[0] == (1e-3, True)
    assert any(again for _, again in asked[1:])


def test_no_run_is_trusted_by_a_first_estimate_alone() -> None:
    """What only the first estimate trusts, and the second look does not, is refined on."""

    def run_at(step: float, is_open) -> LoopRun:
        first = made_up(step, np.arange(3.0) * (1 + step), True)
        return made_up(step, np.arange(3.0) * (1 + step), not is_open(first) or step < 4e-4)

    run, choice = choose_step(run_at)
    assert run.verdict.trusted
    assert choice.tried == ((1e-3, "not converged"), (5e-4, "not converged"), (2.5e-4, "trusted"))


def test_runs_that_are_equal_to_the_last_digit_are_trusted() -> None:
    run, choice = choose_step(with_error(lambda _h: 0.1))
    assert (run.verdict.trusted, len(choice.tried)) == (True, 3)
    assert run.verdict.error_estimate == {"x": 0.0}
