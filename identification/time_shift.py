"""Delay of a recorded force relative to the motion, from the records alone.

Filters, buses and loggers delay one signal more than another. The force is predicted from the
acceleration, a curve over the speed in each direction, and steps over the distance since a
reversal, which covers friction of any law. All signals are smoothed in the same way, so strongly
that position noise in the acceleration is removed and the values between samples are known. The
delay with the least squares is the result; its error comes from pieces of the records.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, binary_opening, gaussian_filter1d
from scipy.stats import t as student

from ..records.record import Record
from .friction_estimation import FrictionEstimate
from .intervals import CONFIDENCE, Interval

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_SAMPLES = 25  # largest delay in each direction, in samples
_SMOOTHER = 1.0  # width of the smoothing, in periods of the position's bandwidth
_KNOWN = 2.0  # a delay within this many prior standard deviations is not corrected
_FALLS = (0.03, 0.15)  # speeds over which friction may fall or rise, over the fast speed
_WAYS = 6  # steps
_REST = 0.005  # share of the fast speed; slower for longer than the smoothing is rest
_NEAR = 0.05  # used distances since a reversal, as a share of the range of positions
_PIECES = 10  # least number of pieces
# Smallest standard error, in sampling intervals: at reversals friction depends on time in a way
# that curves over speed and distance do not contain; for LuGre's law the error has this size.
_FLOOR = 0.25
_FEWEST = 200  # least number of samples in motion
_METHOD = "least squares on a curve over speed and way, errors from pieces of the records"


def steps_of(values: Vector, count: int, where: npt.NDArray[np.bool_]) -> Matrix:
    """One column for each of `count` ranges with as many samples, shape (n, count)."""
    out = np.zeros((len(values), count))
    if where.any():
        edges = np.quantile(values[where], np.linspace(0, 1, count + 1)[1:-1])
        rows = np.flatnonzero(where)
        out[rows, np.searchsorted(edges, values[where])] = 1.0
    return out


def way_since_reversal(x: Vector, v: Vector) -> tuple[Vector, npt.NDArray[np.bool_]]:
    """Distance from the last reversal, shape (n,) [m], and where it is short."""
    turns = np.flatnonzero(np.diff(np.sign(v), prepend=0.0))
    turns = turns if len(turns) else np.array([0])
    last = turns[np.maximum(np.searchsorted(turns, np.arange(len(x)), "right") - 1, 0)]
    way = np.abs(x - x[last])
    return way, way < _NEAR * float(np.ptp(x))


def least_squares(columns: Matrix, values: Vector) -> Vector:
    """Least-squares coefficients; zero for an empty or dependent column, shape (columns,)."""
    size = np.linalg.norm(columns, axis=0)
    size[size <= 1e-12 * size.max(initial=0.0)] = np.inf
    found, *_ = np.linalg.lstsq(columns / size, values, rcond=1e-6)
    return np.asarray(found / size)


@dataclass(frozen=True)
class _Smoothed:
    """A record's force, shape (n,), and its predictors, shape (n, columns), equally smoothed."""

    force: Vector
    columns: Matrix
    step: float
    edge: int
    moves: npt.NDArray[np.bool_]

    def late(self, delay: float) -> Matrix:
        """The columns delayed by `delay` [s], without the record's ends and rests."""
        at = np.flatnonzero(self.inner) - delay / self.step
        first = np.floor(at).astype(int)
        part = (at - first)[:, None]
        return np.asarray((1 - part) * self.columns[first] + part * self.columns[first + 1])

    @property
    def inner(self) -> npt.NDArray[np.bool_]:
        inner = np.arange(len(self.force))
        return self.moves & (inner >= self.edge) & (inner < len(self.force) - self.edge)


def _smoothed(record: Record, estimate: FrictionEstimate) -> _Smoothed | None:
    motion = estimate.motion
    width = max(_SMOOTHER / (motion.bandwidth * record.step), 2.0)
    edge = _SAMPLES + math.ceil(4 * width)
    if len(record.force) < 3 * edge:
        return None
    way, near = way_since_reversal(motion.x, motion.v)
    direction = np.sign(motion.v)[:, None]
    speed = np.abs(motion.v)
    fast = max(float(np.quantile(speed, 0.95)), 1e-12)
    curve = [np.ones(len(speed)), speed, *(np.exp(-speed / (f * fast)) for f in _FALLS)]
    over_speed = np.column_stack([c * (s * motion.v > 0) for c in curve for s in (1, -1)])
    columns = [over_speed, steps_of(way, _WAYS, near) * direction, motion.a[:, None]]
    rests = binary_opening(speed < _REST * fast, np.ones(math.ceil(2 * width)))
    moves = ~binary_dilation(rests, np.ones(2 * math.ceil(3 * width) + 1))
    smooth = gaussian_filter1d(np.column_stack([record.force, *columns]), width, axis=0)
    return _Smoothed(smooth[:, 0], smooth[:, 1:], record.step, edge, moves)


def time_shift(records: Sequence[Record], estimates: Sequence[FrictionEstimate]) -> Interval | None:
    """Delay of the force relative to the motion [s]; None if the records do not give it.

    The mass is free, so that a wrong mass is not interpreted as a delay.

    Parameters
    ----------
    records : sequence of Record
    estimates : sequence of FrictionEstimate
        Estimate of each record.
    """
    told = [_smoothed(r, e) for r, e in zip(records, estimates, strict=True)]
    known = [s for s in told if s is not None]
    if not known:
        return None
    force = np.concatenate([s.force[s.inner] for s in known])
    if len(force) < _FEWEST:
        return None

    def left(delay: float) -> Vector:
        columns = np.vstack([s.late(delay) for s in known])
        return np.asarray(force - columns @ least_squares(columns, force))

    step = min(s.step for s in known)
    grid = step * np.arange(-_SAMPLES, _SAMPLES + 1)
    costs = [float(np.sum(left(d) ** 2)) for d in grid]
    best = int(np.argmin(costs))
    if best in (0, len(grid) - 1):
        return None
    # all three are interpolated in the same way
    around = [left(grid[best] + k * step) for k in (-1, 0, 1)]
    low, middle, high = (float(np.sum(r**2)) for r in around)
    bend = (low - 2 * middle + high) / step**2
    value = float(grid[best] + 0.5 * (low - high) / (bend * step))
    slopes = (around[2] ** 2 - around[0] ** 2) / (2 * step)
    slopes = slopes + (value - grid[best]) * bend / len(slopes)
    count = max(_PIECES, round(sum(np.count_nonzero(s.inner) * s.step for s in known)))
    pieces = np.add.reduceat(slopes, np.linspace(0, len(slopes), count + 1).astype(int)[:-1])
    error = math.sqrt(float(np.sum(pieces**2)) * count / (count - 1)) / bend
    error = math.hypot(error, _FLOOR * step)
    reach = float(student.ppf(0.5 + CONFIDENCE / 2, count - 1)) * error
    return Interval(value, "s", error, value - reach, value + reach, _METHOD, True)


def corrected(
    records: Sequence[Record], shift: Interval | None, delays: Vector
) -> list[Record] | None:
    """The records with their forces shifted; None if the shift agrees with prior knowledge.

    The law's fit must also prefer the shift, because presliding may look like a delay.

    Parameters
    ----------
    records : sequence of Record
    shift : Interval or None
        Result of `time_shift`.
    delays : ndarray
        Delays of the law's fit, which includes the prior [s].
    """
    if shift is None or shift.low is None or shift.high is None or shift.standard_error is None:
        return None
    known = _KNOWN * max(r.delay_std for r in records)
    if any(r.lags for r in records) or (shift.low <= known and shift.high >= -known):
        return None
    if float(np.max(math.copysign(1.0, shift.value) * delays)) < known:
        return None
    return [
        replace(
            r,
            lags={"force": shift.value},
            delay_std=math.hypot(r.delay_std, shift.standard_error),
        )
        for r in records
    ]
