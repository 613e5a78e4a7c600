"""Automatic choice of the communication step: halved until the run can be trusted.

Each run has its own verdict, from its co-run. If that is not enough, successive runs are compared:
if a halving moves the outputs by a share q < 0.7 of the change by the previous halving, all later
changes add up to q / (1 - q) of the last change. If outputs jump, this is not sufficient, and the
last run gets a second look, see `second_look`.

Compiled code tries the shorter steps if it can play the FMUs, see `played`; then the FMUs
themselves repeat the first run that is close enough to the last one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..fmu.fmu_instance import SHORTER
from ..fmu.limits import FIRST_STEP
from .loop_run import LoopRun
from .march import UNBOUNDED
from .second_look import jumps
from .verdict import ACCURACY, Verdict, scales

# Communication steps of a run. Numbers, not seconds: so no result depends on the computer.
MOST, MOST_OF_ISOLATED = 400_000, 40_000
CONVERGES = 0.7  # largest ratio of two successive differences
LEVELS = 12


@dataclass(frozen=True)
class StepChoice:
    """The chosen step [s], the reason, and every tried step with its verdict."""

    step: float
    reason: str
    tried: tuple[tuple[float, str], ...]


def choose_step(
    run_at: Callable[[float, bool], LoopRun],
    first: float = FIRST_STEP,
    try_at: Callable[[float, bool], LoopRun] | None = None,
    most: int = MOST,
) -> tuple[LoopRun, StepChoice]:
    """Run with decreasing steps, from `first` [s] on, until a run can be trusted.

    `run_at` runs with a step; its bool: whether an unclear verdict is checked by finer runs.
    `try_at` is for steps that are only tried: `run_at` repeats the chosen run if it was `played`.
    No run has more than `most` steps, except the first.
    Returns the last run, or the first one that is close enough to it, with the verdict of all.
    """
    step, moved_before = first, np.inf
    runs: list[LoopRun] = []
    words: list[str] = []

    def chosen(number: int, run: LoopRun, reason: str) -> tuple[LoopRun, StepChoice]:
        steps = (first * 0.5 ** np.arange(len(words))).tolist()
        run = _done(run, run_at, steps[number])
        words[number] = run.verdict.word
        return run, StepChoice(steps[number], reason, tuple(zip(steps, words, strict=True)))

    while True:
        at = try_at if try_at and runs else run_at
        before = runs[-1] if runs else None
        moved, bound = np.inf, None
        # a run is trusted only after a second look if its first verdict is not clear
        run = at(step, before is None)
        if before is not None:
            apart = _differences(before, run)
            moved, worst = max((share, name) for name, (_, share) in apart.items())
            verdict = _judged_by_halving(run, apart, moved, worst, moved_before, step)
            if verdict is not None and not _jumps(run):
                bound, run = verdict.error_estimate, replace(run, verdict=verdict)
            elif verdict is None and run.verdict.trusted and _may_wait(run, moved, moved_before):
                text = f"halving the step to {step:g} s moved {worst} by {100 * moved:.2g} %"
                open_ = replace(run.verdict, trusted=False, reason=text, advice=UNBOUNDED)
                run = replace(run, verdict=open_)
            elif verdict is not None or run.verdict.trusted:
                run = at(step, True)
        runs.append(run)
        words.append(run.verdict.word)
        if run.verdict.trusted:
            number = len(runs) - 1
            if run.played and bound:  # a longer step costs less, and may be close enough
                number, run = _first_near(runs, bound, step)
            why = "the first step that was tried" if before is None else f"of {len(runs)} tried"
            return chosen(number, run, f"{why}, the first whose run is trusted")
        ended = _no_further(run, before, moved, moved_before, len(runs))
        to_come = 2 * run.macro_steps
        if not ended and to_come > most:
            ended = (
                f"a step of {step / 2:g} s makes {to_come} steps, and at most {most} are tried; "
                f"use it with --step {step / 2:g}"
            )
        if ended:
            run = replace(run, verdict=replace(run.verdict, advice=ended))
            return chosen(len(runs) - 1, run, f"the last of {len(runs)} tried: {ended}")
        moved_before = moved
        step /= 2.0


def _done(tried: LoopRun, run_at: Callable[[float, bool], LoopRun], step: float) -> LoopRun:
    """Run the FMUs themselves if `tried` was played; keep its verdict if the outputs are equal."""
    if not tried.played:
        return tried
    run = run_at(step, False)
    same = len(run.time) == len(tried.time) and all(
        np.array_equal(values, tried.outputs[name]) for name, values in run.outputs.items()
    )
    return replace(run, verdict=tried.verdict) if same else run_at(step, True)


def _may_wait(run: LoopRun, moved: float, moved_before: float) -> bool:
    """Whether the next halving will probably decide, and costs less than a second look."""
    return run.played and moved <= min(ACCURACY, CONVERGES * moved_before) and not _jumps(run)


def _jumps(run: LoopRun) -> bool:
    """Whether an output jumps."""
    return bool(jumps(np.column_stack(list(run.outputs.values()))).any())


def _first_near(
    runs: list[LoopRun], bound: Mapping[str, float], step: float
) -> tuple[int, LoopRun]:
    """The first run that is close enough to the last, and its number.

    The last run has this step [s], and at most the error `bound`.
    """
    last = len(runs) - 1
    for number, run in enumerate(runs[:-1]):
        apart = _differences(run, runs[-1])
        estimate = {name: size + bound[name] for name, (size, _) in apart.items()}
        shares = {n: size / float(scales(runs[-1].judged[n])) for n, size in estimate.items()}
        worst = max(shares, key=lambda name: shares[name])
        if shares[worst] <= ACCURACY and not _jumps(run):
            text = (
                f"runs with steps down to {step:g} s converge; the "
                f"largest estimated error is in {worst} by {estimate[worst]:.2g}, "
                f"{100 * shares[worst]:.2g} % of its range"
            )
            verdict = Verdict(True, text, "", estimate, run.verdict.contraction)
            return number, replace(run, verdict=verdict)
    return last, runs[-1]


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
    worst: str,
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
        f"range ({worst}: {apart[worst][0]:.2g}); the previous halving moved one by "
        f"{100 * moved_before:.2g} %"
    )
    estimate = {name: to_come * size for name, (size, _) in apart.items()}
    return Verdict(True, text, "", estimate, run.verdict.contraction)


def _no_further(
    run: LoopRun, before: LoopRun | None, moved: float, moved_before: float, tried: int
) -> str:
    """Why a shorter step would not help; empty if it may help."""
    if not run.verdict.step_helps:
        return run.verdict.advice
    discarded = run.verdict.advice == SHORTER
    if run.stopped and run.verdict.advice not in (SHORTER, UNBOUNDED):  # fails with any step
        return run.verdict.advice
    if before is not None and run.stopped and before.stopped and not discarded:
        ends = before.time[-1], run.time[-1]
        if abs(ends[0] - ends[1]) <= 0.02 * max(ends):
            return f"with steps of half the length it ends at the same time: {run.stopped}"
    if tried >= 4 and np.isfinite(moved_before) and moved > 0.9 * moved_before > 0.1:
        return "the runs do not converge with shorter steps; shorten the run"
    if tried >= LEVELS:
        return f"{tried} steps were tried"
    return ""
