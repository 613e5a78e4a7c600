"""The master: run a plant and a controller together, judge the result, and choose the step.

A run with step H is judged by the rungs of one ladder, runs with 4 H and 2 H first, which cost less
than the run itself. If that is not enough, or if an output jumps or the set-point bends within the
steps, a rung with H/2 follows, then one with H/4; where outputs jump, also what they are close to
the jumps (`jumps.py`). The choice of the step walks down the same ladder: no rung is run twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fmu.fmu_instance import SHORTER
from .march import UNBOUNDED, LoopRun, Progress
from .runs import Runs
from .sides import Sides
from .verdict import ACCURACY, Rung, Verdict, moves, scales, verdict_of

# Communication steps of a run. Numbers, not seconds: so no result depends on the computer.
MOST, MOST_OF_ISOLATED = 400_000, 40_000
LEVELS = 12
HOPELESS = 10.0  # times the allowed error: no finer rung follows
FEWEST = 3  # rungs that show whether runs converge


def run_loop(sides: Sides, step: float, *, progress: Progress = None, look: bool = True) -> LoopRun:
    """Run a closed loop of two FMU instances.

    Parameters
    ----------
    sides : Sides
    step : float
        Communication step [s].
    progress : function, optional
        Called repeatedly with the present time of each run.
    look : bool
        Whether the run is judged.

    Returns
    -------
    LoopRun

    Raises
    ------
    StepFailed
        If a part rejects its parameters or initial values.
    UserError
        If the rows of all steps do not fit.
    """
    runs = Runs(sides, step, progress)
    return judged(runs, 0) if look else runs.run(0)


def judged(runs: Runs, level: int, deepest: int = 2) -> LoopRun:
    """The run of a level with its verdict.

    It is from rungs down to so many levels below it; down to two if outputs or set-points jump.
    """
    run = runs.run(level)
    if run.alone and not run.stopped:
        reason = "there is no coupling; this run does not check how accurate the plant's own "
        estimate = dict.fromkeys(runs.names, 0.0)
        verdict = Verdict(True, f"{reason}solver is", "", estimate, run.verdict.contraction)
        return replace(run, verdict=verdict)
    verdict = run.verdict if run.stopped else _verdict(runs, level, deepest)
    return runs.named(level, replace(run, verdict=verdict))


def _verdict(runs: Runs, level: int, deepest: int) -> Verdict:
    verdict = first = runs.run(level).verdict
    own, jump = runs.own(level), runs.jumps(level)
    if not runs.varies and runs.sides.reversible:
        pair = own, runs.otherwise(level)
        return verdict_of(first, runs.names, own, pair, otherwise=True)
    rungs: list[Rung] = []
    irregular = jump or runs.switches(level)  # errors that do not fall evenly with the step
    hidden = irregular or runs.bends(level)  # longer steps may show nothing of it
    for k in (level,) if irregular else (level, level - 1, level - 2):
        rung = runs.rung(k)
        if rung is None or rung.failure:
            break
        rungs.insert(0, rung)
    for below in range(1 + (2 if hidden else deepest)):
        rung = runs.rung(level + below)
        if rung is None or rung.failure:
            return verdict if rung is None else replace(first, reason=rung.failure)
        if below:
            rungs.append(rung)
        if len(rungs) < FEWEST or (hidden and not below):
            continue
        verdict = verdict_of(first, runs.names, own, rungs)
        if verdict.trusted:
            around = runs.around(level, rungs[-1]) if jump else 0.0
            timed = runs.of_command_times(level, below)
            verdict = verdict_of(first, runs.names, own, rungs, around, timed)
        error = np.array([*verdict.error_estimate.values()]) / scales(own.outputs)
        if verdict.trusted or (below and not error.max() <= HOPELESS * ACCURACY):
            break
    return verdict


@dataclass(frozen=True)
class StepChoice:
    """The chosen step [s], the reason, and every tried step with its verdict."""

    step: float
    reason: str
    tried: tuple[tuple[float, str], ...]


def choose_step(runs: Runs, most: int = MOST) -> tuple[LoopRun, StepChoice]:
    """Run with decreasing steps, from level 0 on, until a run can be trusted.

    No run has more than `most` steps, except the first. Returns the last run, with the verdict of
    all.
    """
    tried: list[LoopRun] = []
    ended = ""
    while not (ended or (tried and tried[-1].verdict.trusted)):
        # after the first, the next try says what a second rung below would say
        tried.append(judged(runs, len(tried), 1 if tried else 2))
        ended = "" if tried[-1].verdict.trusted else _ended(runs, tried, most)
    run, count = tried[-1], len(tried)
    why = "the first step that was tried" if count == 1 else f"of {count} tried"
    reason = f"{why}, the first whose run is trusted"
    if ended:
        run = replace(run, verdict=replace(run.verdict, advice=ended))
        reason = f"the last of {count} tried: {ended}"
    words = tuple((runs.step(k), run.verdict.word) for k, run in enumerate(tried))
    return run, StepChoice(words[-1][0], reason, words)


def _ended(runs: Runs, tried: list[LoopRun], most: int) -> str:
    """Why a shorter step would not help, or has too many steps; empty if it may help."""
    run, count, advice = tried[-1], len(tried), tried[-1].verdict.advice
    fails = run.stopped and advice not in (SHORTER, UNBOUNDED)  # with any step
    if fails or not run.verdict.step_helps:
        return advice
    if count > 1 and run.stopped and tried[-2].stopped and advice != SHORTER:
        ends = tried[-2].time[-1], run.time[-1]
        if abs(ends[0] - ends[1]) <= 0.02 * max(ends):
            return f"with steps of half the length it ends at the same time: {run.stopped}"
    if count >= 4 and not run.stopped:
        own = [runs.own(level) for level in range(count - 3, count)]
        before, moved = moves(own, scales(own[-1].outputs))
        if np.isfinite(before) and moved > 0.9 * before > 0.1:
            return "the runs do not converge with shorter steps; shorten the run"
    if count >= LEVELS:
        return f"{count} steps were tried"
    if (to_come := 2 * run.macro_steps) > most:
        step, tries = runs.step(count), f"at most {most} are tried; give this step to use it"
        return f"a step of {step:g} s makes {to_come} steps, and {tries}"
    return ""


def only_step(run: LoopRun, step: float) -> tuple[LoopRun, StepChoice]:
    """Return a run of FMUs that accept only this step [s], with advice that fits, and the step."""
    verdict = run.verdict
    if not verdict.trusted and verdict.step_helps and not run.stopped:
        only = f"its FMUs take steps of {step:g} s only"
        advice = f"{only}: export them with a shorter step, or with variable steps"
        run = replace(run, verdict=replace(verdict, advice=advice, step_helps=False))
    return run, StepChoice(step, "the only one that its FMUs accept", ((step, verdict.word),))
