"""A second check of a run: finer co-runs, and the outputs close to its jumps.

If an output jumps, for example a velocity at an impact, its value is wrong at a communication
point between the true jump and the jump in the run, even if these are very close; and other runs
may jump on the same side. The possible distance in time between the jumps of two runs is measured:
the difference of the runs just before the jump, divided by the speed of the outputs there. If a
jump is closer than that to a communication point, the output at this point is not known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import numpy.typing as npt

from .clock import Clock
from .compiled import GOES_ON, PAIR, library
from .loop_run import CHUNK, LoopRun, RecordedLoop, RunLog
from .reference_signal import Reference
from .structs import struct
from .verdict import ACCURACY, asks_again, scales, second_verdict

Vector = npt.NDArray[np.float64]
March = Callable[[RecordedLoop, list[RecordedLoop], Clock, RunLog, Vector], object]

PARTS = 4096  # of a step: the resolution of times close to a jump
MISTIMED = 3.0  # safety factor on the measured distance in time of two runs' jumps
CLOSEST, FARTHEST = 2, PARTS // 8  # parts; beyond an eighth of a step, the time is not known
SLOWEST = 0.1  # of the fastest output's speed: slower outputs do not show the time of a jump
EVENLY = 8  # parts of a step if the time of its jump is not known
NEAR = 6  # points in any other step, including its ends
STEADY = 2.0  # factor on the change next to a point: a larger change at the point is a jump
SHARP = 0.6  # share of the change in a step: a larger share in an eighth of the step is a jump
BENT = 0.5  # share of a change: a larger difference from the adjacent changes makes it a jump


@dataclass(frozen=True)
class Setting:
    """How the loop of a run is opened again."""

    opened: Callable[[int], RecordedLoop]  # corrected if possible; each step in so many parts
    march: March
    reference: Reference
    orders: tuple[int, ...]  # as in `Wiring`
    breaks: Vector  # further times at which steps end [s]
    start: Vector  # set-points at the start
    nominal: Vector  # of the plant's outputs
    commands: int  # their number
    stop: float  # [s]
    step: float

    def log(self, loop: RecordedLoop) -> RunLog:
        """A log that keeps no commands."""
        outputs = loop.loop.outputs
        return RunLog(self.reference, self.orders, outputs, self.nominal, self.commands, False)


def with_second_look(
    first: LoopRun,
    outputs: Vector,
    others: list[Vector],
    safety: float,
    setting: Setting,
    opened_late: Callable[[], RecordedLoop] | None,
) -> LoopRun:
    """Return the run, with the verdict of a second look if the first one is not clear."""
    n = len(setting.nominal)  # further columns: sampled outputs of controllers jump on time
    blind = len(others) > 1 or bool(jumps(outputs[:, :n]).any())
    if not asks_again(first.verdict, outputs, others[0], safety, blind):
        return first
    found = (others[0], others[1]) if len(others) > 1 else finer(setting, first.time)
    if found is None:
        return first
    judged = outputs.shape[1]  # further columns are only recorded
    half, quarter = (table[:, :judged] for table in found)
    late = delayed(setting, first.time, opened_late()) if opened_late else None
    late = None if late is None else late[:, :judged]
    apart = np.abs(outputs - quarter) + np.abs(half - quarter)
    around = np.zeros_like(outputs)
    around[:, :n] = around_jumps(setting, outputs[:, :n], apart[:, :n])
    verdict = second_verdict(first.verdict, outputs, half, quarter, late, around)
    return replace(first, verdict=verdict)


def jumps(run: Vector) -> npt.NDArray[np.bool_]:
    """Mark steps in which an output changes by more than the tolerance, unlike before or after."""
    change = np.diff(run, axis=0) / scales(run)
    bend = np.abs(np.diff(change, axis=0))
    beside = np.zeros_like(change)
    beside[1:] = bend
    beside[:-1] = np.maximum(beside[:-1], bend)
    size = np.abs(change)
    return np.asarray(((size > ACCURACY) & (beside > BENT * size)).any(axis=1))


def finer(setting: Setting, times: Vector) -> tuple[Vector, Vector] | None:
    """Outputs at the run's times with a half and a quarter of its step; None if these runs fail."""
    half, quarter = setting.opened(1), setting.opened(2)
    tables = _marched(setting, times, setting.step / 2, half, quarter)
    return None if tables is None else (tables[0], tables[1])


def delayed(setting: Setting, times: Vector, loop: RecordedLoop) -> Vector | None:
    """Outputs of a loop at the run's times, with a quarter of its step; None if the loop fails."""
    tables = _marched(setting, times, setting.step / 4, loop)
    return None if tables is None else tables[0]


def _marched(
    setting: Setting, times: Vector, step: float, loop: RecordedLoop, *others: RecordedLoop
) -> list[Vector] | None:
    try:
        log = setting.log(loop)
        clock = Clock(setting.stop, step, False, setting.breaks)
        setting.march(loop, [*others], clock, log, setting.start)
    finally:
        _close(loop, *others)
    tables = [np.concatenate(pair.outputs) for pair in (loop, *others)]
    rows = np.searchsorted(np.concatenate(log.times), times - 1e-6 * setting.step)
    if min(map(len, tables)) <= rows[-1]:
        return None
    return [table[rows] for table in tables]


def around_jumps(setting: Setting, run: Vector, distance: Vector) -> Vector:
    """Part of each output's jump that may belong on the other side of a communication point.

    `run` (k, n) has the outputs at these points, `distance` (k, n) their largest error.
    """
    around = np.zeros_like(run)
    found = np.flatnonzero(jumps(run)).tolist()
    if not found:
        return around
    last = round(setting.stop / setting.step * PARTS)
    rows = {}
    for k in found:
        start, end = k * PARTS, min((k + 1) * PARTS, last)
        rows[k] = [
            start,
            *(start + o for o in _offsets(_parts(k, run, distance), end - start)),
            end,
        ]
    loop = setting.opened(1)
    try:
        seen = _seen_within(setting, loop, len(run), last, rows)
    finally:
        _close(loop)
    for k, looked_at in rows.items():
        if k not in seen:
            beside = np.abs(run[k + 1] - run[k])[None]
        else:
            moved = np.abs(np.diff(seen[k], axis=0))
            if len(looked_at) == NEAR:
                beside = np.array([moved[0] - STEADY * moved[1], moved[-1] - STEADY * moved[-2]])
            else:
                beside = np.where(moved.max(0) > SHARP * moved.sum(0), moved.max(0), 0.0)[None]
        around[k : k + 2] = np.maximum(around[k : k + 2], beside)
    around[0] = 0.0  # the start is given, so a jump right after it is on the right side
    return around


def _parts(k: int, run: Vector, distance: Vector) -> int:
    """Largest error in the time of the jump in step `k` [parts of a step]."""
    if k == 0:
        return CLOSEST
    scale = scales(run)
    speed = np.abs(run[k] - run[k - 1]) / scale
    fastest = speed.max()
    if not fastest > 0:
        return CLOSEST if not distance[k].any() else PARTS
    late = np.max(distance[k] / scale / np.maximum(speed, SLOWEST * fastest))
    return int(np.clip(np.ceil(MISTIMED * late * PARTS), CLOSEST, PARTS))


def _offsets(parts: int, length: int) -> list[int]:
    """Points to check within a step: close to its ends, or evenly if `parts` is too large."""
    if parts <= length * FARTHEST // PARTS:
        return [parts, 2 * parts, length - 2 * parts, length - parts]
    return [length * k // EVENLY for k in range(1, EVENLY)]


def _seen_within(
    setting: Setting, loop: RecordedLoop, points: int, last: int, rows: dict[int, list[int]]
) -> dict[int, Vector]:
    """Outputs at the given rows of each step; empty if the loop fails."""
    clock = Clock(setting.stop, setting.step / PARTS, False, setting.breaks)
    log, nobody = setting.log(loop), struct(PAIR)
    addresses = [record.address for record in (loop, nobody, nobody, clock, log)]
    all_rows = [min(k * PARTS, last) for k in range(points)]
    all_rows = sorted({*all_rows, *(row for within in rows.values() for row in within)})
    for ticks, alike in groupby(np.diff(all_rows).tolist()):
        left = len(list(alike))
        while left:
            clock.next_ticks(ticks)
            why = library().master_march(*addresses, min(left, CHUNK))
            loop.collect()
            if why != GOES_ON:
                return {}
            left -= loop.record.rows
    table = np.concatenate(loop.outputs)[:, : len(setting.nominal)]
    return {k: table[np.searchsorted(all_rows, within)] for k, within in rows.items()}


def _close(*loops: RecordedLoop) -> None:
    for loop in loops:
        loop.loop.plant.close()
        loop.loop.controller.close()
