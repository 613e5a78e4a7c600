"""A coupled run: its communication steps in time, those of its co-runs, its record and result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ...solver.arrays import Vector
from ..fmu.compiled import FARTHEST, Why, call, struct
from ..fmu.fmu_instance import StepFailed
from .coupling import CHUNK, CoupledPair
from .couplings import WITHOUT_FMUS, Coupling
from .reference_signal import ROUND_OFF, Reference
from .verdict import Verdict

Progress = Callable[[float], None] | None

LONGEST_WAIT = 0.05  # s; after a chunk that took longer, the next one is shorter
NEGLIGIBLE = 1e-7  # of the range: a smaller sum of effects is round-off
UNKNOWN = 1e12  # like FARTHEST, for outputs without a known nominal value
UNBOUNDED = StepFailed("").advice


@dataclass(frozen=True)
class LoopRun:
    """A coupled run."""

    time: Vector  # shape (k,), like all courses; communication points [s]
    outputs: dict[str, Vector]  # of the plant, under the names they are mapped to
    commands: dict[str, Vector]  # of the controller, under the names of the plant's inputs
    reference: Vector
    residual_max: dict[str, float]  # largest coupling residual of each command, in its unit
    effect_rate_max: dict[str, float]  # largest of the residual, per second; empty: not corrected
    macro_steps: int
    step_range: tuple[float, float]  # shortest and longest communication step [s]
    verdict: Verdict
    stopped: str = ""  # why the run ended early; empty if it did not
    coupling: Coupling | None = None  # None: one system of equations, without FMUs
    coupling_reason: str = "as asked"  # reason for the coupling, if it was chosen by rule
    corrected: bool = False
    others: dict[str, Vector] = field(default_factory=dict)  # further outputs of the controller
    units: dict[str, str] = field(default_factory=dict)  # as far as the parts declare them
    sampling_period: float = 0.0  # of the controller and its instruments [s]; 0: not sampled
    scale: tuple[float, float] = (1.0, 0.0)  # factor and offset from SI to the set-point's unit
    limit: float = math.inf  # largest command that the plant lets through, in the command's unit
    between: LoopRun | None = None  # with points between these, where equations are solved

    @property
    def coupled_by(self) -> str:
        """The coupling's name."""
        return self.coupling.value if self.coupling else WITHOUT_FMUS

    @property
    def alone(self) -> bool:
        """Whether the plant ran without commands, and so without a set-point."""
        return not self.commands


class Clock:
    """State of a run in time, from zero to `stop`, with steps of a length [s].

    Communication points are multiples of one tick, so that time does not drift. A step must also
    end at each of the rising `breaks` [s]. A step may be shortened to 2^-`finer` of the length.
    """

    def __init__(self, stop: float, step: float, breaks: ArrayLike = (), finer: int = 0) -> None:
        tick = step / 2**finer
        close = max(ROUND_OFF * step, 1e-14 * stop)
        times = np.asarray(breaks, dtype=float)
        times = times[(times > close) & (times < stop - close)]
        self.whole = struct("Clock")
        self.whole.set(tick=tick, stop=stop, last=max(1, math.ceil(stop / tick - 1e-9)))
        self.whole.set(longest=2**finer, stride=2**finer, shortest_used=math.inf)
        self.whole.set(close=close, breaks=times[np.diff(times, prepend=0.0) > close])

    @property
    def now(self) -> float:
        """Present time [s]."""
        return float(call("clock_now", self.whole))

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return bool(self.whole.record.count >= self.whole.record.last)

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
    known = nominal != 1.0
    return np.where(known | (np.mean(known) > 0.5), FARTHEST, UNKNOWN) * size


class Record:
    """The rows of a run in chunks, the measurements during it, and how it ended.

    Each of the set-points has one of `orders`; the commands at the end of each step are kept if
    asked.
    """

    def __init__(
        self, pair: CoupledPair, reference: Reference, orders: Sequence[int], commands: bool = True
    ) -> None:
        outputs, m = pair.outputs, len(pair.given)
        nominal = np.array([pair.plant.nominal(name) for name in pair.plant.outputs])
        self.bounds = bounds(nominal, outputs)
        self.residual, self.effect_rate = np.zeros(m), np.zeros(len(outputs))
        self._room = np.empty(CHUNK), np.empty(CHUNK), np.empty((CHUNK, m * commands))
        shown = 0, *orders  # the recorded set-point, then those of the controller
        self.whole = struct("Course")
        self.whole.set(**dict(zip(("times", "references", "commands"), self._room, strict=True)))
        self.whole.set(residual=self.residual, effect_rate=self.effect_rate)
        self.whole.set(nominal=nominal, bounds=self.bounds, low=outputs.copy(), high=outputs.copy())
        self.whole.set(goal_times=np.ascontiguousarray(reference.times, dtype=float))
        pieces = np.stack([reference.pieces(k) for k in shown], axis=1)
        self.whole.set(goal_pieces=pieces.ravel())
        self.whole.set(before=np.zeros(len(shown)), after=np.zeros(len(shown)))
        self._goal, *start = reference.all_at(0.0, shown)
        self.start = np.array(start)
        self._chunks: list[Sequence[Vector]] = []
        self.advice = UNBOUNDED

    def begin(self, commands: Vector) -> None:
        """Record the start."""
        self._chunks = [[np.zeros(1), np.array([self._goal]), commands[None]]]

    def collect(self, rows: int) -> None:
        """Keep what the last chunk recorded."""
        self._chunks.append([room[:rows].copy() for room in self._room])

    def courses(self) -> list[Vector]:
        """Times (k,), set-points (k,) and commands (k, m) of all rows."""
        return [np.concatenate(parts) for parts in zip(*self._chunks, strict=True)]

    @property
    def contraction(self) -> float:
        """Of the corrections, weighted by their effect; 0 if they had none."""
        record = self.whole.record
        return float(record.contraction / record.weight) if record.weight >= NEGLIGIBLE else 0.0


def march(
    run: CoupledPair, clock: Clock, record: Record, most: int, co_run: CoupledPair | None = None
) -> Why:
    """Move a loop, and its co-run, by up to `most` steps; `GOES_ON`, or why it ended."""
    other = co_run.whole if co_run else 0
    why = Why(call("master_march", run.whole, other, clock.whole, record.whole, most))
    for pair in [run, co_run] if co_run else [run]:
        pair.collect()
    record.collect(run.whole.record.rows)
    return why


def march_on(
    run: CoupledPair,
    clock: Clock,
    record: Record,
    co_run: CoupledPair | None = None,
    progress: Progress = None,
) -> None:
    """Move a loop, and its co-run, to the clock's end; a failure ends it early."""
    first = call("clock_step_to_come", clock.whole)
    record.begin(run.commands("command_now", 0.0, first, record.start, False))
    for pair in [run, co_run] if co_run else [run]:
        pair.begin()
    why, most = Why.GOES_ON, 1
    while why is Why.GOES_ON and not clock.done:
        began = time.perf_counter()
        why = march(run, clock, record, most, co_run)
        # short chunks: interruptions and progress are handled between two of them
        slow = time.perf_counter() - began > LONGEST_WAIT
        most = max(1, most // 2) if slow else min(2 * most, CHUNK)
        if progress:
            progress(clock.now)
    if why is Why.STEP_FAILED:
        error = run.error()
        run.failure = f"{error} (in the step from t = {clock.now:.6g} s)"
        record.advice = error.advice
    elif why is Why.DIVERGES:
        beyond = np.nan_to_num(np.abs(run.outputs) / record.bounds, nan=np.inf)
        name = list(run.plant.outputs)[int(np.argmax(beyond))]
        run.failure = f"the loop diverges: {name} exceeds its bound at t = {clock.now:.6g} s"
