"""Communication steps of a loop and its reference co-runs: their times and their record."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..fmu.fmu_instance import StepFailed
from .compiled import (
    CALL_FAILED,
    COMMAND_FAILED,
    DIVERGES,
    FARTHEST,
    GOES_ON,
    NOT_FINITE,
    STEP_FAILED,
    call,
    struct,
)
from .coupling import CHUNK, CoupledPair
from .reference_signal import ROUND_OFF, Reference
from .verdict import ACCURACY

Vector = npt.NDArray[np.float64]
Progress = Callable[[float], None]

FINEST = 12  # adaptive steps go down to 2^-12 of the given one
LONGEST_WAIT = 0.05  # s; after a chunk that took longer, the next one is shorter
NEGLIGIBLE = 1e-7  # of the range: a smaller sum of effects is round-off
UNKNOWN = 1e12  # like FARTHEST, for outputs without a known nominal value
UNBOUNDED = StepFailed("").advice


class Clock:
    """State of a run in time: from zero, with fixed steps or with steps up to a length.

    Communication points are multiples of one tick, so that time does not drift.

    Parameters
    ----------
    stop, step : float
        [s]
    adaptive : bool
    breaks : array_like, shape (m,)
        Rising times at which a step must also end [s].
    """

    def __init__(
        self, stop: float, step: float, adaptive: bool = False, breaks: npt.ArrayLike = ()
    ) -> None:
        size = 2**FINEST if adaptive else 1
        tick = step / size
        last = max(1, math.ceil(stop / tick - 1e-9))
        self.whole = struct("Clock")
        self.whole.set(tick=tick, stop=stop, last=last, longest=size, stride=size)
        self.whole.set(adaptive=adaptive, shortest_used=math.inf)
        close = max(ROUND_OFF * step, 1e-14 * stop)
        times = np.asarray(breaks, dtype=float)
        times = times[(times > close) & (times < stop - close)]
        times = times[np.diff(times, prepend=0.0) > close]
        self.whole.set(close=close, breaks=times)

    @property
    def now(self) -> float:
        """Present time [s]."""
        return float(call("clock_now", self.whole))

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return bool(self.whole.record.count >= self.whole.record.last)

    @property
    def step_to_come(self) -> float:
        """Length of the next step [s]: a multiple of the tick, except a last, shorter one."""
        return float(call("clock_step_to_come", self.whole))

    def next_ticks(self, count: int) -> None:
        """Set the length of the next step of a fixed-step clock in ticks."""
        self.whole.set(stride=count)

    @property
    def used(self) -> tuple[float, float]:
        """Shortest and longest step so far [s]."""
        record = self.whole.record
        return float(record.shortest_used), float(record.longest_used)


def bounds(nominal: Vector, start: Vector) -> Vector:
    """Largest outputs before a loop counts as diverged.

    A nominal value of 1 counts as missing, unless most of the others are given. Values in counts,
    in pascals or of absolute encoders are far above 1 at rest.
    """
    size = np.maximum(np.maximum(nominal, 1.0), np.abs(np.nan_to_num(start)))
    told = nominal != 1.0
    return np.where(told | (np.mean(told) > 0.5), FARTHEST, UNKNOWN) * size


class Record:
    """The rows of a run in chunks, and the measurements during the run.

    Each of the set-points has one of `orders`; the commands at the end of each step are kept if
    asked.
    """

    def __init__(
        self,
        pair: CoupledPair,
        reference: Reference,
        orders: Sequence[int],
        keeps_commands: bool = True,
    ) -> None:
        outputs, m = pair.outputs, len(pair.given)
        nominal = np.array([pair.plant.nominal(name) for name in pair.plant.outputs])
        self.bounds = bounds(nominal, outputs)
        self.residual, self.effect_rate = np.zeros(m), np.zeros(len(outputs))
        self._room = np.empty(CHUNK), np.empty(CHUNK), np.empty((CHUNK, m * keeps_commands))
        self.whole = struct("Course")
        self.whole.set(
            times=self._room[0],
            references=self._room[1],
            commands=self._room[2],
            nominal=nominal,
            bounds=self.bounds,
            low=outputs.copy(),
            high=outputs.copy(),
            residual=self.residual,
            effect_rate=self.effect_rate,
            apart=np.zeros(len(outputs)),
            goal_times=np.ascontiguousarray(reference.times, dtype=float),
            goal_pieces=np.stack([reference.pieces(k) for k in (0, *orders)], axis=1).ravel(),
            accuracy=ACCURACY,
            before=np.zeros(len(orders)),
            after=np.zeros(len(orders)),
        )
        self.start = reference.all_at(0.0, orders)
        self.times, self.references = [np.zeros(1)], [np.array([reference.at(0.0)])]
        self.commands: list[Vector] = []

    def collect(self, rows: int) -> None:
        """Keep what the last chunk recorded."""
        kept = self.times, self.references, self.commands
        for chunks, room in zip(kept, self._room, strict=True):
            chunks.append(room[:rows].copy())

    @property
    def contraction(self) -> float:
        """Of the corrections, weighted by their effect; 0 if they had none."""
        record = self.whole.record
        weight = record.contraction_weight
        return float(record.contraction / weight) if weight >= NEGLIGIBLE else 0.0


@dataclass(frozen=True)
class Stop:
    """Reason for the early end of a run; empty if it did not end early."""

    reason: str = ""
    advice: str = UNBOUNDED
    diverged: bool = False


def march(pairs: Sequence[CoupledPair], clock: Clock, record: Record, most: int) -> int:
    """Move a loop, and up to two co-runs, by up to `most` steps; `GOES_ON`, or why it ended.

    Raises `StepFailed` if a loop cannot save or restore its state.
    """
    nobody = struct("Pair")
    wholes = [*(p.whole for p in pairs), nobody, nobody][:3]
    why = int(call("master_march", *wholes, clock.whole, record.whole, most))
    if why == CALL_FAILED:
        raise next(p.error() for p in pairs if p.failed())
    for pair in pairs:
        pair.collect()
    return why


def march_on(
    pairs: Sequence[CoupledPair], clock: Clock, record: Record, progress: Progress | None = None
) -> Stop:
    """Move a loop, and up to two reference co-runs, to the clock's end.

    Raises `StepFailed` if a loop cannot save or restore its state; other failures end the run.
    """
    main = pairs[0]
    record.commands.append(main.command(0.0, clock.step_to_come, record.start)[None])
    for pair in pairs:
        pair.begin()
    why, most = GOES_ON, 1
    while why == GOES_ON and not clock.done:
        began = time.perf_counter()
        why = march(pairs, clock, record, most)
        record.collect(main.record.rows)
        # short chunks: interruptions and progress are handled between two of them
        slow = time.perf_counter() - began > LONGEST_WAIT
        most = max(1, most // 2) if slow else min(2 * most, CHUNK)
        if progress:
            progress(clock.now)
    t = clock.now
    if why in (STEP_FAILED, COMMAND_FAILED):
        error = main.error()
        where = f"in the step from t = {t:.6g} s" if why == STEP_FAILED else f"at t = {t:.6g} s"
        return Stop(f"{error} ({where})", error.advice)
    if why == NOT_FINITE:
        return Stop(f"an output is not finite at t = {t:.6g} s", diverged=True)
    if why == DIVERGES:
        worst = int(np.argmax(np.abs(main.outputs) / record.bounds))
        name = list(main.plant.outputs)[worst]
        return Stop(f"the loop diverges: {name} exceeds its bound at t = {t:.6g} s", diverged=True)
    return Stop()
