"""Automatic choice of the communication step: halved until the run can be trusted.

Each run has its own verdict, from its co-run. If that is not enough, successive runs are compared:
if a halving moves the outputs by a share q < 0.7 of the change by the previous halving, all later
changes add up to q / (1 - q) of the last change. If outputs jump, this is not sufficient, and the
last run gets a second look, see `second_look`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..fmu.fmu_instance import SHORTER
from ..fmu.limits import FIRST_STEP
from .march import UNBOUNDED, LoopRun
from .second_look import jumps
from .verdict import ACCURACY, Verdict, scales

# Communication steps of a run. Numbers, not seconds: so no result depends on the computer.
MOST, MOST_OF_ISOLATED = 400_000, 40_000
RunAt = Callable[[float, Callable[[LoopRun], bool]], LoopRun]
CONVERGES = 0.7  # largest ratio of two successive differences
LEVELS = 12


@dataclass(frozen=True)
class StepChoice:
    """The chosen step [s], the reason, and every tried step with its verdict."""

    step: float
    reason: str
    tried: tuple[tuple[float, str], ...]


def choose_step(
    run_at: RunAt, first: float = FIRST_STEP, most: int = MOST
) -> tuple[LoopRun, StepChoice]:
    """Run with decreasing steps, from `first` [s] on, until a run can be trusted.

    `run_at` runs with a step; its function tells whether that run needs a second look.
    No run has more than `most` steps, except the first. Returns the last run, with the verdict of
    all.
    """
    tried = _Tried(first)
    while True:
        run = tried.next(run_at)
        count = len(tried.runs)
        if run.verdict.trusted:
            why = "the first step that was tried" if count == 1 else f"of {count} tried"
            return run, tried.choice(f"{why}, the first whose run is trusted")
        if ended := tried.ended(most):
            run = replace(run, verdict=replace(run.verdict, advice=ended))
            return run, tried.choice(f"the last of {count} tried: {ended}")


class _Tried:
    """Runs with decreasing steps, and by which share of its range each halving moved an output."""

    def __init__(self, first: float) -> None:
        self._first = first
        self.runs: list[LoopRun] = []
        self._moved = [np.inf]

    def _step(self, number: int) -> float:
        return self._first * 0.5**number

    def next(self, run_at: RunAt) -> LoopRun:
        """Run with the next step; its verdict is that of the halvings if they are enough."""
        run = run_at(self._step(len(self.runs)), self._is_open)
        if self.runs:
            moved, verdict = self._halved(run)
            self._moved.append(moved)
            if verdict is not None and not _jumps(run):
                run = replace(run, verdict=verdict)
        self.runs.append(run)
        return run

    def _is_open(self, run: LoopRun) -> bool:
        """Whether a run needs a second look: trusted by a first estimate only, or it jumps."""
        if not self.runs:
            return True
        _, verdict = self._halved(run)
        return run.verdict.trusted if verdict is None else _jumps(run)

    def _halved(self, run: LoopRun) -> tuple[float, Verdict | None]:
        """What the last halving moved, as a share, and the verdict of all halvings, if any."""
        apart, step = _differences(self.runs[-1], run), self._step(len(self.runs))
        moved, worst = max((share, name) for name, (_, share) in apart.items())
        said = f"({worst}: {apart[worst][0]:.2g})"
        return moved, _judged_by_halving(run, apart, moved, said, self._moved[-1], step)

    def ended(self, most: int) -> str:
        """Why a shorter step would not help, or has too many steps; empty if it may help."""
        run, count = self.runs[-1], len(self.runs)
        if not run.verdict.step_helps:
            return run.verdict.advice
        discarded = run.verdict.advice == SHORTER
        if run.stopped and run.verdict.advice not in (SHORTER, UNBOUNDED):  # fails with any step
            return run.verdict.advice
        if count > 1 and run.stopped and self.runs[-2].stopped and not discarded:
            ends = self.runs[-2].time[-1], run.time[-1]
            if abs(ends[0] - ends[1]) <= 0.02 * max(ends):
                return f"with steps of half the length it ends at the same time: {run.stopped}"
        before, moved = self._moved[-2:] if count > 1 else (np.inf, np.inf)
        if count >= 4 and np.isfinite(before) and moved > 0.9 * before > 0.1:
            return "the runs do not converge with shorter steps; shorten the run"
        if count >= LEVELS:
            return f"{count} steps were tried"
        if (to_come := 2 * run.macro_steps) > most:
            step = self._step(count)
            return (
                f"a step of {step:g} s makes {to_come} steps, and at most {most} are tried; "
                f"use it with --step {step:g}"
            )
        return ""

    def choice(self, reason: str) -> StepChoice:
        """The last step, with all tried ones."""
        tried = tuple((self._step(k), run.verdict.word) for k, run in enumerate(self.runs))
        return StepChoice(tried[-1][0], reason, tried)


def _jumps(run: LoopRun) -> bool:
    """Whether an output jumps."""
    return bool(jumps(np.column_stack(list(run.outputs.values()))).any())


def only_step(run: LoopRun, step: float) -> tuple[LoopRun, StepChoice]:
    """Return a run of FMUs that accept only this step [s], with advice that fits, and the step."""
    verdict = run.verdict
    if not verdict.trusted and verdict.step_helps and not run.stopped:
        advice = (
            f"its FMUs take steps of {step:g} s only: export them with a shorter step, "
            "or with variable steps"
        )
        run = replace(run, verdict=replace(verdict, advice=advice, step_helps=False))
    tried = ((step, verdict.word),)
    return run, StepChoice(step, "the only one that its FMUs accept", tried)


def _differences(coarse: LoopRun, fine: LoopRun) -> Mapping[str, tuple[float, float]]:
    """Largest difference of two runs for each output, and its share of the output's range."""
    end = min(coarse.time[-1], fine.time[-1])
    times = coarse.time[coarse.time <= end]
    found = {}
    for name, values in fine.judged.items():
        there = np.interp(times, fine.time, values)
        with np.errstate(invalid="ignore", over="ignore"):
            apart = float(np.max(np.abs(there - coarse.judged[name][: len(times)])))
        share = apart / float(scales(there))
        found[name] = apart, share if np.isfinite(share) else np.inf
    return found


def _judged_by_halving(
    run: LoopRun,
    apart: Mapping[str, tuple[float, float]],
    moved: float,
    said: str,
    moved_before: float,
    step: float,
) -> Verdict | None:
    """The verdict of the halvings if they converge within the accuracy, else None."""
    if run.stopped or not np.isfinite(moved_before) or not moved <= CONVERGES * moved_before:
        return None  # one difference alone shows no convergence
    share = moved / moved_before if moved_before > 0.0 else 0.0
    to_come = max(1.0, share / (1.0 - share))
    if not to_come * moved <= ACCURACY:
        return None
    text = (
        f"halving the step to {step:g} s moved no output by more than {100 * moved:.2g} % of its "
        f"range {said}; the previous halving moved one by "
        f"{100 * moved_before:.2g} %"
    )
    estimate = {name: to_come * size for name, (size, _) in apart.items()}
    return Verdict(True, text, "", estimate, run.verdict.contraction)
