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
from ballscrew.orchestration.master.master import choose_step, judged, only_step
from ballscrew.orchestration.master.verdict import Rung, Verdict


def made_up(step: float, values: np.ndarray, stopped: str = "", trusted: bool = False) -> LoopRun:
    time = np.linspace(0.0, 1.0, len(values))
    return LoopRun(
        time=time,
        outputs={"x": values},
        commands={"u": values},
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


class MadeUp:
    """Runs of x = t whose error is a function of the level; they may jump, or end early."""

    names, varies = ("x",), True

    def __init__(self, error, jump=0.0, ends=lambda _level: (1.0, "")):
        self.error, self.jump, self.ends, self.ran = error, jump, ends, []

    def step(self, level):
        return 1e-3 / 2.0**level

    def run(self, level):
        end, stopped = self.ends(level)
        time = np.linspace(0.0, 1.0, 201)
        values = time + self.error(level) * np.sin(np.pi * time) + self.jump * (time > 0.5)
        run = made_up(self.step(level), values, stopped)
        return replace(run, time=end * run.time)

    def rung(self, level):
        if level not in self.ran:
            self.ran.append(level)
        return self.own(level)

    def own(self, level):
        run = self.run(level)
        return Rung(self.step(level), run.time, run.outputs["x"][:, None])

    def of_command_times(self, _level, _below):
        return 0.0

    def switches(self, _level):
        return False

    def jumps(self, _level):
        return self.jump > 0.0

    def bends(self, _level):
        return False

    def around(self, _level, _finest):
        return np.array([0.02 * self.jump])

    def named(self, _level, run):
        return run


@pytest.mark.parametrize("order", [1, 2])
def test_runs_that_converge_are_trusted_and_the_estimate_bounds_the_error(order: int) -> None:
    runs = MadeUp(lambda level: 0.1 / 2.0 ** (order * level))
    run, choice = choose_step(runs)
    assert run.verdict.trusted
    error = runs.error(len(choice.tried) - 1)
    assert error <= run.verdict.error_estimate["x"] * (1 + 1e-9)
    assert run.verdict.error_estimate["x"] <= 0.01 * 1.2
    assert max(runs.ran) <= len(choice.tried)  # no rung is more than one level below


def test_longer_steps_decide_alone_if_they_are_enough() -> None:
    runs = MadeUp(lambda level: 1e-3 / 4.0**level)
    run, choice = choose_step(runs)
    assert choice.tried == ((1e-3, "trusted"),)
    assert sorted(runs.ran) == [-2, -1, 0]
    assert run.verdict.error_estimate["x"] == pytest.approx(3e-3)
    assert "by runs with steps down to 0.001 s" in run.verdict.reason


@pytest.mark.parametrize(("size", "deepest"), [(0.03, 2), (0.3, 1)])
def test_shorter_steps_follow_unless_it_is_hopeless(size, deepest) -> None:
    """Runs that come closer by a fifth only; hopeless is ten times what is allowed."""
    runs = MadeUp(lambda level: size * 0.8**level)
    assert not judged(runs, 0).verdict.trusted
    assert max(runs.ran) == deepest


@pytest.mark.parametrize(("jump", "trusted"), [(0.5, True), (2.0, False)])
def test_what_jumps_is_judged_by_shorter_steps_only_and_the_parts_of_its_jumps(
    jump, trusted
) -> None:
    runs = MadeUp(lambda _level: 0.0, jump)
    verdict = judged(runs, 0).verdict
    assert verdict.trusted is trusted
    assert verdict.error_estimate["x"] == pytest.approx(0.02 * jump)
    assert runs.ran == [0, 1, 2]


@pytest.mark.parametrize(("apart", "number"), [(0.12, 4), (0.09, 12)])
def test_runs_that_do_not_come_closer_to_each_other_are_given_up(apart, number) -> None:
    run, choice = choose_step(MadeUp(lambda level: apart * (level % 2)))
    assert not run.verdict.trusted
    assert len(choice.tried) == number
    assert ("do not converge" in choice.reason) == (number == 4)
    assert run.verdict.advice


@pytest.mark.parametrize(("end", "number"), [(0.981, 2), (0.979, 12)])
def test_runs_that_end_at_the_same_time_are_not_refined_on(end, number) -> None:
    told = "the loop diverges: x exceeds its bound"
    runs = MadeUp(lambda _level: 0.0, ends=lambda level: (end if level % 2 else 1.0, told))
    run, choice = choose_step(runs)
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
    runs = MadeUp(lambda level: level % 2, ends=lambda _level: (1.0, stopped))
    verdict = Verdict(False, "its own", advice, {"x": 1.0}, step_helps=helps)
    runs.named = lambda _level, run: replace(run, verdict=verdict)
    _, choice = choose_step(runs)
    assert len(choice.tried) == number
    assert (advice in choice.reason) == (number == 1)


def test_a_step_that_makes_too_many_steps_is_only_named() -> None:
    """A run of 120 000 steps, then one of 240 000."""
    runs = MadeUp(lambda level: 50 * 0.8**level)
    runs.named = lambda level, run: replace(run, macro_steps=120_000 * 2**level)
    run, choice = choose_step(runs)
    assert len(choice.tried) == 2
    assert "a step of 0.00025 s makes 480000 steps, and at most 400000" in run.verdict.advice


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
    run, choice = only_step(made_up(1e-3, np.arange(3.0)), 1e-3)
    assert (choice.step, choice.tried) == (1e-3, ((1e-3, "not converged"),))
    assert "its FMUs take steps of 0.001 s only" in run.verdict.advice
    assert not run.verdict.step_helps
    fine = made_up(1e-3, np.arange(3.0), trusted=True)
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
    assert figures["steps_tried"][-1] == [1.25e-4, "trusted"]
    assert main([*arguments, "--step", "1e-3"]) == 1
    assert json.loads((out / "metrics.json").read_text())["step_reason"] == "as asked"
