"""A communication step that chooses itself: halved until the run can be trusted.

Each run has a verdict of its own, from its co-run. Where that is not enough, runs of one after the
other step judge: where a halving moves the outputs by a share q < 0.7 of what the halving before
moved them, what is still to come adds up to q / (1 - q) of the last difference. Where outputs jump,
that says too little, and the last run is looked at again, see `second_look`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import monotonic

import numpy as np

from .fmu_instance import SHORTER
from .loop_run import UNBOUNDED, LoopRun
from .second_look import jumps
from .verdict import ACCURACY, Verdict, scales

FIRST = 1e-3  # s
LONGEST = 60.0  # s of computing that a run may take in all, as far as can be foreseen
CONVERGES = 0.7  # share of the difference before that a difference may be
LEVELS = 12


@dataclass(frozen=True)
class StepChoice:
    """Which step was taken, and why.

    Attributes
    ----------
    step : float
        [s]
    reason : str
    tried : tuple of tuple (float, str)
        Every step that was tried [s], and the word of its verdict.
    """

    step: float
    reason: str
    tried: tuple[tuple[float, str], ...]


def choose_step(
    run_at: Callable[[float, bool], LoopRun], first: float = FIRST
) -> tuple[LoopRun, StepChoice]:
    """Run with shorter and shorter steps until a run can be trusted.

    Parameters
    ----------
    run_at : function of a step [s], and of whether the run is looked at again by finer ones
    first : float
        The longest step to try [s].

    Returns
    -------
    LoopRun
        The last, with the verdict that the last runs give together.
    StepChoice
    """
    began = monotonic()
    step, before, moved_before = first, None, np.inf
    tried: list[tuple[float, str]] = []
    while True:
        start = monotonic()
        # a verdict that trusts is always that of a run that was looked at again where not clear
        run = run_at(step, before is None)
        seconds = monotonic() - start
        if run.verdict.trusted and before is not None:
            run = run_at(step, True)
        if not run.verdict.trusted and before is not None:
            apart = _differences(before, run)
            moved, worst = max((share, name) for name, (_, share) in apart.items())
            verdict = _judged_by_halving(run, apart, moved, worst, moved_before, step)
            if verdict.trusted and jumps(np.column_stack(list(run.outputs.values()))).any():
                run = run_at(step, True)
            else:
                run = replace(run, verdict=verdict)
        else:
            moved = np.inf
        tried.append((step, run.verdict.word))
        if run.verdict.trusted:
            why = "the first that was tried" if before is None else f"of {len(tried)} tried"
            return run, StepChoice(step, f"{why}, the first whose run is trusted", tuple(tried))
        ended = _no_further(run, before, moved, moved_before, len(tried))
        foreseen = 2.0 * seconds
        late = monotonic() - began + foreseen > LONGEST
        if not ended and before is not None and late:  # the first may have been looked at again
            ended = (
                f"a step of {step / 2:g} s would take about {foreseen:.0f} s of computing; "
                f"ask for it with --step {step / 2:g}"
            )
        if ended:
            verdict = replace(run.verdict, advice=ended)
            choice = StepChoice(step, f"the last of {len(tried)} tried: {ended}", tuple(tried))
            return replace(run, verdict=verdict), choice
        before, moved_before = run, moved
        step /= 2.0


def only_step(run: LoopRun, step: float) -> tuple[LoopRun, StepChoice]:
    """A run whose FMUs take steps [s] of one length alone: no other one is advised."""
    verdict = run.verdict
    if not verdict.trusted and verdict.step_helps and not run.stopped:
        advice = (
            f"its FMUs take steps of {step:g} s alone: export them with a shorter step, or so that "
            "they take any"
        )
        run = replace(run, verdict=replace(verdict, advice=advice, step_helps=False))
    tried = ((step, verdict.word),)
    return run, StepChoice(step, "the only one that its FMUs take", tried)


def _differences(coarse: LoopRun, fine: LoopRun) -> Mapping[str, tuple[float, float]]:
    """By output: the largest difference of two runs, and its share of the output's range."""
    end = min(coarse.time[-1], fine.time[-1])
    times = coarse.time[coarse.time <= end]
    found = {}
    for name, values in fine.outputs.items():
        there = np.interp(times, fine.time, values)
        with np.errstate(invalid="ignore", over="ignore"):
            apart = float(np.max(np.abs(there - coarse.outputs[name][: len(times)])))
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
) -> Verdict:
    """The run's own verdict, or that of the halvings where they converge."""
    if run.stopped or not np.isfinite(moved_before) or not moved <= CONVERGES * moved_before:
        return run.verdict  # one difference alone shows no convergence
    share = moved / moved_before if moved_before > 0.0 else 0.0
    to_come = max(1.0, share / (1.0 - share))
    if not to_come * moved <= ACCURACY:
        return run.verdict
    text = (
        f"halving the step to {step:g} s moved no output by more than {100 * moved:.2g} % of its "
        f"range ({worst}: {apart[worst][0]:.2g}); the halving before moved one by "
        f"{100 * moved_before:.2g} %"
    )
    estimate = {name: to_come * size for name, (size, _) in apart.items()}
    return Verdict(True, text, "", estimate, run.verdict.contraction)


def _no_further(
    run: LoopRun, before: LoopRun | None, moved: float, moved_before: float, tried: int
) -> str:
    """Why a shorter step would not help; empty where it may."""
    if not run.verdict.step_helps:
        return run.verdict.advice
    discarded = run.verdict.advice == SHORTER
    if run.stopped and run.verdict.advice not in (SHORTER, UNBOUNDED):  # a part died, whatever h
        return run.verdict.advice
    if before is not None and run.stopped and before.stopped and not discarded:
        ends = before.time[-1], run.time[-1]
        if abs(ends[0] - ends[1]) <= 0.02 * max(ends):
            return f"with steps of half the length it ends at the same time: {run.stopped}"
    if tried >= 4 and np.isfinite(moved_before) and moved > 0.9 * moved_before > 0.1:
        return "shorter steps do not bring the runs closer to each other; shorten the run"
    if tried >= LEVELS:
        return f"{tried} steps were tried"
    return ""
