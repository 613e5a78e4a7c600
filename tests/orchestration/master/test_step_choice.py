"""Communication steps that choose themselves."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.fmu.fmu_instance import SHORTER
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.march import UNBOUNDED, LoopRun
from ballscrew.orchestration.master.master import choose_step, judged
from ballscrew.orchestration.master.verdict import Rung, Verdict


class MadeUp:
    """Runs of x = t whose error is a function of the level; they may jump, or end early."""

    names, varies = ("x",), True
    switches = bends = staticmethod(lambda _level: False)
    of_command_times = staticmethod(lambda _level, _below: 0.0)
    named = staticmethod(lambda _level, run: run)

    def __init__(self, error, jump=0.0, ends=lambda _level: (1.0, "")):
        self.error, self.jump, self.ends, self.ran = error, jump, ends, []

    def step(self, level):
        return 1e-3 / 2.0**level

    def run(self, level):
        end, stopped = self.ends(level)
        time, step = np.linspace(0.0, 1.0, 201), self.step(level)
        x = time + self.error(level) * np.sin(np.pi * time) + self.jump * (time > 0.5)
        verdict = Verdict(False, "its own", UNBOUNDED)
        how = {}, {}, 200, (step, step), verdict, stopped, Coupling.JACOBI
        return LoopRun(end * time, {"x": x}, {"u": x}, 0.0 * x, *how)

    def rung(self, level):
        if level not in self.ran:
            self.ran.append(level)
        return self.own(level)

    def own(self, level):
        run = self.run(level)
        return Rung(self.step(level), run.time, run.outputs["x"][:, None])

    def jumps(self, _level):
        return self.jump > 0.0

    def around(self, _level, _finest):
        return np.array([0.02 * self.jump])

    def with_verdict(self, advice, helps):
        verdict = Verdict(False, "its own", advice, {"x": 1.0}, step_helps=helps)
        self.named = lambda _level, run: replace(run, verdict=verdict)
        return self


@pytest.mark.parametrize("order", [1, 2])
def test_runs_that_converge_are_trusted_and_the_estimate_bounds_the_error(order: int) -> None:
    runs = MadeUp(lambda level: 0.1 / 2.0 ** (order * level))
    run, choice = choose_step(runs)
    assert run.verdict.trusted
    assert runs.error(len(choice.tried) - 1) <= run.verdict.error_estimate["x"] * (1 + 1e-9)
    assert run.verdict.error_estimate["x"] <= 0.01 * 1.2
    assert max(runs.ran) == len(choice.tried) - (order == 1)  # at most one level below


@pytest.mark.parametrize(
    ("runs", "ran", "estimate"),
    [
        # longer steps decide alone if they are enough; shorter ones follow, unless the estimate is
        # ten times what is allowed
        (MadeUp(lambda level: 1e-3 / 4.0**level), [-2, -1, 0], 3e-3),
        (MadeUp(lambda level: 0.02 * 0.87**level), [-2, -1, 0, 1, 2], 0.02),
        (MadeUp(lambda level: 0.3 * 0.8**level), [-2, -1, 0, 1], 0.12),
        # what jumps is judged by shorter ones only, and by the parts of its jumps
        (MadeUp(lambda _level: 0.0, jump=0.5), [0, 1, 2], 0.01),
        (MadeUp(lambda _level: 0.0, jump=2.0), [0, 1, 2], 0.04),
    ],
)
def test_as_many_rungs_are_run_as_are_needed(runs, ran, estimate) -> None:
    verdict = judged(runs, 0).verdict
    assert sorted(runs.ran) == ran
    assert verdict.error_estimate["x"] == pytest.approx(estimate)
    assert verdict.trusted == (estimate <= 0.01 * max(1.0, runs.jump))


def far(level):
    return level % 2


def ending(end, told="the loop diverges: x exceeds its bound"):
    """Runs without an error that end, every second one at another time."""
    return MadeUp(lambda _level: 0.0, ends=lambda level: (end if level % 2 else 1.0, told))


@pytest.mark.parametrize(
    ("runs", "number", "told"),
    [
        (MadeUp(lambda level: 0.12 * far(level)), 4, "the runs do not converge"),
        (MadeUp(lambda level: 0.09 * far(level)), 12, "12 steps were tried"),
        (ending(0.981), 2, "it ends at the same time: the loop diverges"),
        (ending(0.979), 12, "12 steps were tried"),
        (ending(1.0, "it failed").with_verdict("mend the FMU", True), 1, "mend the FMU"),
        (ending(1.0, "it failed").with_verdict(SHORTER, True), 12, "12 steps were tried"),
        (MadeUp(far).with_verdict("whatever the step", False), 1, "whatever the step"),
    ],
)
def test_what_no_shorter_step_mends_is_given_up(runs, number, told) -> None:
    run, choice = choose_step(runs)
    assert not run.verdict.trusted
    assert len(choice.tried) == number
    assert told in choice.reason
    assert told in run.verdict.advice


def test_a_step_that_makes_too_many_steps_is_only_named() -> None:
    """A run of 120 000 steps, then one of 240 000."""
    runs = MadeUp(lambda level: 50 * 0.8**level)
    runs.named = lambda level, run: replace(run, macro_steps=120_000 * 2**level)
    run, choice = choose_step(runs)
    assert len(choice.tried) == 2
    assert "a step of 0.00025 s makes 480000 steps, and at most 400000" in run.verdict.advice


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
