"""What the outputs are close to their jumps.

If an output jumps, for example a velocity at an impact, its value is wrong at a communication
point between the true jump and the jump in the run, even if these are very close; and other runs
may jump on the same side. The possible distance in time between the jumps of two runs is measured:
the difference of the runs just before the jump, divided by the speed of the outputs there. If a
jump is closer than that to a communication point, the output at this point is not known; except if
it is exactly there, as the tick of a clock: then it is on the same side of the point in all runs.
"""

from __future__ import annotations

from contextlib import closing
from itertools import groupby

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ..fmu.compiled import Why
from .coupling import CHUNK
from .march import Clock, Record, march
from .sides import Sides
from .verdict import ACCURACY, scales

PIECES = 4096  # of a step: the resolution of times close to a jump
TICKS = 256  # of such a part: a jump closer than one tick to a point is exactly there
BEFORE = 4  # ticks before a point, in which a controller answers, also if it is a step late
MISTIMED = 3.0  # safety factor on the measured distance in time of two runs' jumps
CLOSEST, FARTHEST = 2, PIECES // 8  # parts; beyond an eighth of a step, the time is not known
SLOWEST = 0.1  # of the fastest output's speed: slower outputs do not show the time of a jump
EVENLY = 8  # parts of a step if the time of its jump is not known
NEAR = 6  # points in any other step, including its ends
STEADY = 2.0  # factor on the change next to a point: a larger change at the point is a jump
SHARP = 0.6  # share of the change in a step: a larger share in an eighth of the step is a jump
BENT = 0.5  # share of a change: a larger difference from the adjacent changes makes it a jump


def jumps(run: Vector) -> npt.NDArray[np.bool_]:
    """Mark steps in which an output changes by more than the tolerance, unlike before or after.

    The first steps are not marked as long as their changes get smaller: what dies out after the
    start begins at the same time in all runs.
    """
    change = np.diff(run, axis=0) / scales(run)
    bend = np.abs(np.diff(change, axis=0))
    beside = np.zeros_like(change)
    beside[1:] = bend
    beside[:-1] = np.maximum(beside[:-1], bend)
    size = np.abs(change)
    marked = np.asarray(((size > ACCURACY) & (beside > BENT * size)).any(axis=1))
    largest = size.max(axis=1)
    unlike_start = ~marked | (np.diff(largest, prepend=np.inf) >= 0.0)
    marked[: int(np.argmax(unlike_start)) if unlike_start.any() else None] = False
    return marked


def around_jumps(sides: Sides, step: float, breaks: Vector, run: Vector, error: Vector) -> Vector:
    """Part of each output's jump that may belong on the other side of a communication point.

    `run` (k, n) has the outputs at these points, `error` (k, n) the largest of each; steps of
    this length also end at the times `breaks` [s].
    """
    around = np.zeros_like(run)
    parts = {k: _parts(k, run, error) for k in np.flatnonzero(jumps(run)).tolist()}
    if not parts:
        return around
    seen = _seen_within(sides, step, breaks, len(run), parts)
    beside = {k: _beside(run[k : k + 2], seen.get(k)) for k in parts}
    jumped = {k: 0 for k in seen if (beside[k] > 0.0).any()}
    again = _seen_within(sides, step, breaks, len(run), jumped) if jumped else {}
    for k, outputs in again.items():
        exact = np.abs(np.diff(outputs, axis=0))[[BEFORE, -1]]
        exact = exact if len(beside[k]) == 2 else exact.max(axis=0)
        beside[k] = np.where(exact > SHARP * beside[k], 0.0, beside[k])
    for k, size in beside.items():
        around[k : k + 2] = np.maximum(around[k : k + 2], size)
    around[0] = 0.0  # the start is given, so a jump right after it is on the right side
    return around


def _beside(ends: Vector, seen: Vector | None) -> Vector:
    """What jumps next to the start and the end of a step, from its outputs there and within it."""
    if seen is None:
        return np.asarray(np.abs(ends[1] - ends[0])[None])
    moved = np.abs(np.diff(seen, axis=0))
    if len(seen) == NEAR:
        return np.array([moved[0] - STEADY * moved[1], moved[-1] - STEADY * moved[-2]])
    return np.asarray(np.where(moved.max(0) > SHARP * moved.sum(0), moved.max(0), 0.0)[None])


def _parts(k: int, run: Vector, distance: Vector) -> int:
    """Largest error in the time of the jump in step `k` [parts of a step]."""
    if k == 0:
        return CLOSEST
    scale = scales(run)
    speed = np.abs(run[k] - run[k - 1]) / scale
    fastest = speed.max()
    if not fastest > 0:
        return CLOSEST if not distance[k].any() else PIECES
    late = np.max(distance[k] / scale / np.maximum(speed, SLOWEST * fastest))
    return int(np.clip(np.ceil(MISTIMED * late * PIECES), CLOSEST, PIECES))


def _points(start: int, end: int, parts: int) -> list[int]:
    """Points to check from the start to the end of a step [ticks].

    They are close to its ends, or even if `parts` is too large. If it is 0, they are a tick after
    the start, and so many ticks before both that a controller answers before them to what was
    earlier: only what happens in the last tick jumps in the last tick.
    """
    length, near = end - start, parts * TICKS
    if not parts:
        before = [[max(at - k, 0) for k in range(BEFORE, -1, -1)] for at in (start, end)]
        return [*before[0], start + 1, *before[1]]
    if parts > length * FARTHEST // (PIECES * TICKS):
        inside = [length * k // EVENLY for k in range(1, EVENLY)]
    else:
        inside = [near, 2 * near, length - 2 * near, length - near]
    return [start, *(start + offset for offset in inside), end]


def _seen_within(
    sides: Sides, step: float, breaks: Vector, points: int, parts: dict[int, int]
) -> dict[int, Vector]:
    """Outputs within steps, by their numbers, at the points of `_points`; empty if it fails."""
    whole = PIECES * TICKS
    last = round(sides.stop / step * whole)
    ends = [min(k * whole, last) for k in range(points + 1)]
    rows = {k: _points(ends[k], ends[k + 1], size) for k, size in parts.items()}
    all_rows = sorted({*ends[:points], *(row for within in rows.values() for row in within)})
    clock = Clock(sides.stop, step / whole, breaks)
    with closing(sides.best()) as pair:
        record = Record(pair, sides.reference, sides.wiring.orders, False)
        pair.begin()
        for ticks, alike in groupby(np.diff(all_rows).tolist()):
            left = len(list(alike))
            clock.whole.set(stride=ticks)
            while left:
                if march(pair, clock, record, min(left, CHUNK)) is not Why.GOES_ON:
                    return {}
                left -= pair.whole.record.rows
    table = np.concatenate(pair.rows)[:, : len(pair.outputs)]
    return {k: table[np.searchsorted(all_rows, within)] for k, within in rows.items()}
