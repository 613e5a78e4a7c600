"""Communication steps that choose themselves."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.loop_run import UNBOUNDED, LoopRun
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.step_choice import choose_step
from ballscrew.orchestration.verdict import Verdict
from ballscrew.orchestration.whole_loop import run_monolithic

WRONG_ESTIMATES = {"sigma0_hat": 66967.8, "sigma1_hat": 352.0}


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
    """Runs of x = t whose error is a function of the step, and no verdict of their own."""

    def run_at(step: float, _again: bool) -> LoopRun:
        time = np.linspace(0.0, 1.0, 11)
        return made_up(step, time + error(step) * time, False)

    return run_at


def test_a_run_that_is_trusted_at_once_is_taken() -> None:
    run, choice = choose_step(lambda h, _again: made_up(h, np.arange(3.0), True))
    assert run.verdict.trusted
    assert choice.step == 1e-3
    assert choice.tried == ((1e-3, "trusted"),)


@pytest.mark.parametrize("order", [1, 2])
def test_halvings_that_converge_are_trusted_and_bound_the_error(order: int) -> None:
    def error(step: float) -> float:
        return 0.2 * (step / 1e-3) ** order

    run, choice = choose_step(with_error(error))
    assert run.verdict.trusted
    assert "halving the step" in run.verdict.reason
    assert error(choice.step) <= run.verdict.error_estimate["x"] * (1 + 1e-9)
    assert run.verdict.error_estimate["x"] <= 0.01 * 1.2


def test_differences_that_are_small_but_do_not_shrink_are_not_trusted() -> None:
    jumps = iter([0.0, 0.3, -0.3] + [0.008, -0.008] * 10)
    run, choice = choose_step(with_error(lambda _h: next(jumps)))
    assert [word for _, word in choice.tried[:5]] == ["not converged"] * 5
    assert run.verdict.advice


def test_runs_that_end_at_the_same_time_are_not_refined_on() -> None:
    run, choice = choose_step(
        lambda h, _again: made_up(
            h, np.arange(3.0), False, "the loop diverges: x exceeds its bound"
        )
    )
    assert not run.verdict.trusted
    assert len(choice.tried) == 2
    assert "same time" in choice.reason


def test_a_loop_that_was_left_to_the_user_is_refined_until_it_is_right(native) -> None:
    parts = str(native("iol")), str(native("plant"))
    study = Loop(*parts, stop=3.0, controller_values=WRONG_ESTIMATES)
    result = run_closed_loop(study)
    assert result.trusted
    assert result.step_choice is not None
    assert result.step_choice.tried[0] == (1e-3, "not converged")
    exact = run_monolithic(
        Loop(
            "iol", reference=Reference.constant(0.08), stop=3.0, controller_values=WRONG_ESTIMATES
        ),
        1e-3,
    )
    for name, values in exact.outputs.items():
        there = np.interp(exact.time, result.run.time, result.run.outputs[name])
        assert np.abs(there - values).max() <= 0.01 * np.ptp(values), name


def test_the_command_says_which_step_was_taken_and_why(native, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    given = ["--set", "controller.sigma0_hat=66967.8", "--set", "controller.sigma1_hat=352"]
    parts = ["--controller", str(native("iol")), "--plant", str(native("plant"))]
    arguments = ["run", *parts, *given, "--stop", "1.5", "--out", str(out)]
    assert main(arguments) == 0
    assert "the first whose run is trusted" in capsys.readouterr().out
    figures = json.loads((out / "metrics.json").read_text())
    assert figures["steps_tried"][0] == [1e-3, "not converged"]
    assert figures["steps_tried"][-1][1] == "trusted"
    assert main([*arguments, "--step", "1e-3"]) == 1
    assert json.loads((out / "metrics.json").read_text())["step_reason"] == "as asked"


def test_halvings_of_what_jumps_are_looked_at_again() -> None:
    asked = []

    def run_at(step: float, again: bool) -> LoopRun:
        asked.append((step, again))
        values = np.linspace(0.0, 1.0, 11) * (1 + 0.2 * step / 1e-3) + (np.arange(11) > 5)
        return made_up(step, values, False)

    choose_step(run_at)
    assert asked[0] == (1e-3, True)
    assert any(again for _, again in asked[1:])


def test_no_run_is_trusted_by_a_first_estimate_alone() -> None:
    """What only the first estimate trusts, and the second look does not, is refined on."""
    run, choice = choose_step(
        lambda h, again: made_up(h, np.arange(3.0) * (1 + h), not again or h < 4e-4)
    )
    assert run.verdict.trusted
    assert choice.tried == ((1e-3, "not converged"), (5e-4, "not converged"), (2.5e-4, "trusted"))


@pytest.mark.parametrize("same", [True, False])
def test_steps_are_tried_by_what_plays_and_the_first_that_is_near_enough_is_run(same) -> None:
    asked, tried = [], []

    def values(step: float) -> np.ndarray:
        return np.linspace(0.0, 1.0, 11) * (1 + 1600.0 * step**2)

    def run_at(step: float, again: bool) -> LoopRun:
        asked.append((step, again))
        return made_up(step, values(step) + (0.0 if same else 1e-9), False)

    def try_at(step: float, again: bool) -> LoopRun:
        tried.append(step)
        return replace(made_up(step, values(step), False), played=True)

    run, choice = choose_step(run_at, 4e-3, try_at)
    # of errors of 2.56, 0.64, 0.16 %: the last halving moved it by 0.48 %, which bounds the last
    assert tried == [2e-3, 1e-3]
    assert choice.step == 2e-3
    word = "trusted" if same else "not converged"
    assert choice.tried == ((4e-3, "not converged"), (2e-3, word), (1e-3, "trusted"))
    assert asked[:2] == [(4e-3, True), (2e-3, False)]
    assert asked[2:] == ([] if same else [(2e-3, True)])
    assert not run.played
    assert run.verdict.trusted == same
    if same:
        error = np.abs(run.outputs["x"] - np.linspace(0.0, 1.0, 11)).max()
        assert error <= run.verdict.error_estimate["x"]
