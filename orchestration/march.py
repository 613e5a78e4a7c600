"""Many communication steps of a loop and its companions, as compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .clock import accept, adapt, done, next_time, now, step_to_come
from .coupling_step import LOOP, command, drop, forget_step, keep, step, take_back
from .structs import VECTOR, compiled, copy, numbers
from .verdict import ACCURACY

Vector = npt.NDArray[np.float64]

RUNAWAY = 1e4  # times an output's nominal value
LEAST_SHARE = 1e-3  # of the error that is allowed in all, to any one step

GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, RUNS_AWAY = range(5)

PAIR = np.dtype(
    [
        ("loop", LOOP),
        ("parts", np.int64),  # into how many a companion divides each step; 0 if it is not there
        ("recorded", VECTOR),  # outputs at the end of each step, row by row
        ("rows", np.int64),
        ("failed", float),  # time of the step in which a companion failed [s], NaN before
    ]
)
"""A loop with what it records."""

COURSE = np.dtype(
    [
        ("times", VECTOR),
        ("references", VECTOR),
        ("commands", VECTOR),  # row by row
        ("nominal", VECTOR),  # of each output, and its range so far
        ("low", VECTOR),
        ("high", VECTOR),
        ("defect", VECTOR),  # largest of each command,
        ("effect_rate", VECTOR),  # and of its effect on each output, per second
        ("contraction", float),  # sums of contraction by weight and of weight
        ("contraction_weight", float),
        ("apart", VECTOR),  # run and companion after the last step
        # the reference: its points, and how many inputs it goes to; room for two set-points
        ("goal_times", VECTOR),
        ("goal_values", VECTOR),
        ("before", VECTOR),
        ("after", VECTOR),
    ]
)
"""The run as it is recorded, what is measured along it, and what it is to follow."""


@compiled
def set_point(course: Any, t: float) -> float:
    """The set-point at a time [s]: linear between the reference's points, held outside of them."""
    times, values = numbers(course.goal_times), numbers(course.goal_values)
    k = np.searchsorted(times, t, side="right")
    if k == 0:
        return float(values[0])
    if k == len(times):
        return float(values[-1])
    slope = (values[k] - values[k - 1]) / (times[k] - times[k - 1])
    return float(slope * (t - times[k - 1]) + values[k - 1])


@compiled
def _stepped(loop: Any, t: float, h: float, before: Vector, after: Vector) -> bool:
    """Whether the loop could do the step."""
    try:
        step(loop, t, h, before, after)
    except Exception:
        forget_step(loop)
        return False
    return True


@compiled
def _commanded(loop: Any, t: float, h: float, goal: Vector, last: bool, commands: Vector) -> bool:
    """Whether the controller could say its command."""
    try:
        command(loop, t, h, goal, last, commands)
    except Exception:
        forget_step(loop)
        return False
    return True


@compiled
def _runs(companion: Any) -> bool:
    return bool(companion.parts > 0 and np.isnan(companion.failed))


@compiled
def _record_outputs(pair: Any) -> None:
    outputs = numbers(pair.loop.outputs)
    n = len(outputs)
    copy(outputs, numbers(pair.recorded)[pair.rows * n : (pair.rows + 1) * n])
    pair.rows += 1


@compiled
def _step_companion(pair: Any, t: float, h: float, before: Vector, after: Vector) -> None:
    """Move a companion over the same step, in as many parts as it has, until it fails."""
    if not _runs(pair):
        return
    parts = pair.parts
    start, end = before.copy(), after.copy()
    for j in range(parts):
        for k in range(len(before)):
            start[k] = before[k] + (after[k] - before[k]) * j / parts
            end[k] = before[k] + (after[k] - before[k]) * (j + 1) / parts
        if not _stepped(pair.loop, t + j * h / parts, h / parts, start, end):
            pair.failed = t
            return
    _record_outputs(pair)


@compiled
def _apart(companion: Any, outputs: Vector, k: int) -> float:
    """How far an output of the run and of its companion are from each other."""
    return outputs[k] - numbers(companion.loop.outputs)[k] if _runs(companion) else 0.0


@compiled
def _correction(main: Any, companion: Any, effect: Vector) -> float:
    """Effect and contraction of this step's correction, by whichever loop was corrected."""
    loop, other = main.loop, companion.loop
    if other.corrected and _runs(companion):
        copy(numbers(other.effect), effect)
        return float(other.contraction)
    copy(numbers(loop.effect), effect)
    return float(loop.contraction)


@compiled
def march(
    main: Any, companion: Any, second_companion: Any, clock: Any, course: Any, most: int
) -> int:
    """Do up to `most` accepted steps, recorded from row 0 on.

    Returns
    -------
    int
        `GOES_ON`, or why the run ended.
    """
    loop = main.loop
    outputs, nominal = numbers(loop.outputs), numbers(course.nominal)
    low, high, apart = numbers(course.low), numbers(course.high), numbers(course.apart)
    defect, effect_rate = numbers(course.defect), numbers(course.effect_rate)
    before, after = numbers(course.before), numbers(course.after)
    n, m = len(outputs), loop.controller.m
    effect, commands = np.zeros(n), np.zeros(m)
    main.rows = companion.rows = second_companion.rows = 0
    before[:] = set_point(course, now(clock))
    while not done(clock) and main.rows < most:
        t, h, end = now(clock), step_to_come(clock), next_time(clock)
        goal = set_point(course, end)
        after[:] = goal
        kept = clock.adaptive and _runs(companion)
        if clock.adaptive:
            keep(loop)
        if kept:
            keep(companion.loop)
        if not _stepped(loop, t, h, before, after):
            drop(loop)
            drop(companion.loop)
            return STEP_FAILED
        _step_companion(companion, t, h, before, after)
        _step_companion(second_companion, t, h, before, after)
        contraction = _correction(main, companion, effect)
        weight, worst = 0.0, 0.0
        for k in range(n):
            low[k], high[k] = min(low[k], outputs[k]), max(high[k], outputs[k])
            scale = max(high[k] - low[k], 1e-2 * nominal[k])
            weight = max(weight, effect[k] / scale)
            worst = max(worst, abs(_apart(companion, outputs, k) - apart[k]) / scale)
        share = max(weight, worst) / (ACCURACY * max(h / clock.stop, LEAST_SHARE))
        if clock.adaptive:
            if share > 1.0 and clock.stride > 1:
                take_back(loop)
                if kept:
                    take_back(companion.loop)
                    companion.rows, companion.failed = main.rows, np.nan
                adapt(clock, share)
                continue
            drop(loop)
            drop(companion.loop)
        accept(clock)
        if np.isfinite(contraction) and weight > 0:
            course.contraction += contraction * weight
            course.contraction_weight += weight
        for k in range(m):
            defect[k] = max(defect[k], abs(numbers(loop.defect)[k]))
        for k in range(n):
            effect_rate[k] = max(effect_rate[k], effect[k] / h)
            apart[k] = _apart(companion, outputs, k)
        if clock.adaptive:
            adapt(clock, share)
        following = h if done(clock) else step_to_come(clock)
        if not _commanded(loop, end, following, after, done(clock), commands):
            return COMMAND_FAILED
        row = main.rows
        numbers(course.times)[row] = end
        numbers(course.references)[row] = goal
        copy(commands, numbers(course.commands)[row * m : (row + 1) * m])
        _record_outputs(main)
        copy(after, before)
        for k in range(n):
            if not np.isfinite(outputs[k]):
                return NOT_FINITE
        for k in range(n):
            if abs(outputs[k]) > RUNAWAY * nominal[k]:
                return RUNS_AWAY
    return GOES_ON
