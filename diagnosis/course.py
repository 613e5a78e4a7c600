"""One record on its way through a diagnosis: signals, motion, noise, and the law along it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..records.drive_record import DriveRecord
from ..records.resolution import fast_noise
from .compiled import compiled
from .drive_model import DriveModel, midway
from .innovations import smooth

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_FIRST_RMS = 2.0  # of the friction: before the law is known along the motion
_FIRST_MEMORY = 0.02  # [s]
_SHAKES = 6  # draws that tell how a doubtful position blurs the law
_SHAKE_MEMORY = 0.01  # [s]
_SHARPEST = 0.1  # of a count to which an edge tells where a slow drive is
_NEAR = 2.0  # counts
_LONGEST_REST = 0.05  # near one place, beyond which samples tell nothing [s]


@dataclass(frozen=True)
class Noise:
    """Of the instruments, and of the force that no model foretells.

    Attributes
    ----------
    channels : ndarray, shape (channels,)
        Variances of position [m^2] and current [A^2].
    rms, memory : float
        Of the unmodelled force [N] and how soon it forgets itself [s].
    """

    channels: Vector
    rms: float
    memory: float


@dataclass(frozen=True)
class Course:
    """A record with its motion as the drive's own equations smooth it.

    Attributes
    ----------
    record : DriveRecord
    channels : tuple of {"x", "i"}
    signals : ndarray, shape (n, channels)
    x, v, i : ndarray, shape (n,)
        Smoothed motion and the current [m, m/s, A]; `i` is zero without a motor.
    blur : ndarray, shape (n,)
        Standard deviation of `x` [m].
    unknown : ndarray, shape (n,)
        What opposes the motion beside the law [N], as smoothed.
    bristle : ndarray, shape (n,)
        The law's force without its viscous part and offset, on average over the interval after
        each sample [N].
    extra : ndarray, shape (n,)
        Variance of the force that the doubt of the position makes [N^2].
    coarse : ndarray, shape (n, channels)
        By how much more a sample's variance is than its instrument's: a counted position that
        rests in one count says the same again and again.
    """

    record: DriveRecord
    channels: tuple[str, ...]
    signals: Matrix
    x: Vector
    v: Vector
    i: Vector
    blur: Vector
    unknown: Vector
    bristle: Vector
    extra: Vector
    coarse: Matrix

    @property
    def step(self) -> float:
        return self.record.step

    @property
    def time(self) -> Vector:
        """From the record's start [s]."""
        return np.asarray(self.record.time - self.record.time[0])

    @cached_property
    def rests(self) -> npt.NDArray[np.bool_]:
        """Where the drive stays within two of the encoder's counts for long, shape (n,).

        Such samples do not count: there rounding is no noise but one unknown constant, and the law,
        which is stiff at rest, makes a force of it.
        """
        stays = np.ones(len(self.x))
        if self.record.count:
            _dwell(self.x, _NEAR * self.record.count, stays)
        return np.asarray(stays * self.step > _LONGEST_REST)

    def shown(self, current: Matrix) -> npt.NDArray[np.float64]:
        """A current, shape (n, m), as the channels show it, shape (n, channels, m)."""
        out = np.zeros((len(self.x), len(self.channels), current.shape[1]))
        if "i" in self.channels:
            out[:, self.channels.index("i")] = current
        return out

    @property
    def middle_x(self) -> Vector:
        """Position in the middle of the interval after each sample [m]."""
        return midway(self.x)

    @property
    def middle_v(self) -> Vector:
        """Velocity on average over the interval after each sample [m/s]."""
        return midway(self.v)

    @property
    def mean_i(self) -> Vector:
        """Current late in the interval after each sample, when it has settled [A]."""
        return np.append(self.i[1:], self.i[-1])

    @property
    def mean_a(self) -> Vector:
        """Acceleration on average over the interval after each sample [m/s^2]."""
        change = np.diff(self.v) / self.step
        return np.append(change, change[-1])

    @property
    def u(self) -> Vector:
        return self.record.u


def instrument_noise(record: DriveRecord) -> tuple[tuple[str, ...], Matrix, Vector]:
    """Channels, signals (n, channels) and variances of the instruments."""
    x = record.signals["x"]
    count = record.count
    # a drive that trembles is no noise of its encoder
    spread = max(count / math.sqrt(12) if count else fast_noise(x), 1e-12)
    channels, columns, variances = ["x"], [x], [spread**2]
    if "i" in record.signals:
        channels.append("i")
        columns.append(record.signals["i"])
        variances.append(max(fast_noise(record.signals["i"]), 1e-9) ** 2)
    return tuple(channels), np.column_stack(columns), np.array(variances)


def lay_along(record: DriveRecord, model: DriveModel) -> Course:
    """Smooth the motion, first without any law, then with what the law says along it."""
    channels, signals, variances = instrument_noise(record)
    n = len(record.time)
    nothing = np.zeros(n)
    course = Course(
        record,
        channels,
        signals,
        x=nothing,
        v=nothing,
        i=nothing,
        blur=nothing,
        unknown=nothing,
        bristle=nothing,
        extra=nothing,
        coarse=np.ones(signals.shape),
    )
    noise = Noise(variances, _FIRST_RMS * model.friction_scale, _FIRST_MEMORY)
    course = _smoothed(course, model, noise, np.zeros(n), np.zeros(n))
    for rms in (0.5, 0.1):
        course = _sharpened(course)
        noise = replace(noise, rms=rms * model.friction_scale)
        friction = model.friction(course.x, course.v, course.step)
        extra = _blurred(course, model, friction)
        course = _smoothed(course, model, noise, friction, extra)
    return follow(course, model)


def resmoothed(
    course: Course,
    model: DriveModel,
    noise: Noise,
    more: Vector,
    volts: Vector,
    amperes: Vector,
) -> Course:
    """The course in the light of better values.

    Parameters
    ----------
    more, volts, amperes : ndarray, shape (n,)
        Force beside the law's [N], command beside the recorded, and what a sample of the current
        shows beyond what commands make of it [A].
    """
    friction = model.friction(course.x, course.v, course.step) + more
    return follow(_smoothed(course, model, noise, friction, course.extra, volts, amperes), model)


def follow(course: Course, model: DriveModel) -> Course:
    """The course with the law's force along it."""
    friction = model.friction(course.x, course.v, course.step)
    extra = _blurred(course, model, friction)
    offset = 0.0 if model.has_motor else model.values["offset"]
    return replace(course, bristle=friction - offset, extra=extra)


def opposing(course: Course, model: DriveModel) -> Vector:
    """The law's whole force along the course, on average over each interval, shape (n,) [N]."""
    law = model.friction(course.x, course.v, course.step)
    return law + model.linear_friction * course.middle_v


def _smoothed(
    course: Course,
    model: DriveModel,
    noise: Noise,
    friction: Vector,
    extra: Vector,
    volts: Vector | float = 0.0,
    amperes: Vector | None = None,
) -> Course:
    drive = model.linear(course.step, course.channels, noise.channels, noise.rms, noise.memory)
    start = np.zeros(len(drive.move))
    start[0] = course.signals[0, 0]
    signals = course.signals
    if amperes is not None:
        signals = signals - course.shown(amperes[:, None])[:, :, 0]
    given = (signals, course.coarse, course.u + volts, friction, extra, start)
    out = smooth(drive, *given)
    state = out.state
    current = state[:, 2] if model.has_motor else np.zeros(len(state))
    return replace(
        course,
        x=np.ascontiguousarray(state[:, 0]),
        v=np.ascontiguousarray(state[:, 1]),
        i=np.ascontiguousarray(current),
        blur=out.spread[:, 0],
        unknown=np.ascontiguousarray(state[:, -1]),
    )


def _sharpened(course: Course) -> Course:
    """A counted position read by its edges.

    The sample after an edge was crossed lies within what the drive went since the one before it;
    one without a new count says no more than those before it. Both are in `coarse`. To take all
    counts for rounded positions would tie their error to the command of a controller that acts on
    them.
    """
    count = course.record.count
    if not count:
        return course
    x = course.record.x
    # since the sample before; where the drive turns round, as far as it may have gone in between
    since = np.abs(np.diff(course.x, prepend=course.x[0]))
    bend = np.abs(np.gradient(np.gradient(course.x)))
    bend = np.maximum(bend, np.maximum(np.append(bend[1:], 0.0), np.append(0.0, bend[:-1])))
    way = np.minimum(np.maximum(since, np.append(since[1:], 0.0)) + bend, count)
    steps = np.diff(x, prepend=x[0])
    read = np.where(steps > 0, x + 0.5 * way, x + 0.5 * count)
    read = np.where(steps < 0, x + count - 0.5 * way, read) - 0.5 * count
    ends = np.concatenate([[0], np.flatnonzero(steps), [len(x)]])
    lengths = np.diff(ends)
    coarse = np.repeat(lengths.astype(float), lengths)
    coarse = np.where(steps != 0, np.maximum(way / count, _SHARPEST) ** 2, coarse)
    signals, factors = course.signals.copy(), course.coarse.copy()
    signals[:, 0], factors[:, 0] = read, coarse
    return replace(course, signals=signals, coarse=factors)


@compiled
def _dwell(x: Vector, near: float, stays: Vector) -> None:
    """How many samples in a row, around each, are within `near` of it."""
    n = len(x)
    for k in range(n):
        first = k
        while first > 0 and abs(x[first - 1] - x[k]) < near:
            first -= 1
        last = k
        while last + 1 < n and abs(x[last + 1] - x[k]) < near:
            last += 1
        stays[k] = last - first + 1


def _blurred(course: Course, model: DriveModel, friction: Vector) -> Vector:
    """Variance of the law's force that the doubt of the position makes, as white noise [N^2].

    Where a counted position rests, nobody knows where in its count it does: that is one constant
    for each rest, and what it makes of the bristles goes on until they have slid.
    """
    random = np.random.default_rng(0)
    n = len(friction)
    memory = max(_SHAKE_MEMORY / course.step, 1.0)
    kernel = np.exp(-0.5 * (np.arange(-4 * memory, 4 * memory + 1) / memory) ** 2)
    rests = course.rests
    turns = np.cumsum(np.diff(rests.astype(int), prepend=0) == 1)
    total = np.zeros(n)
    for _ in range(_SHAKES):
        white = random.standard_normal(n + len(kernel) - 1)
        shake = np.convolve(white, kernel / math.sqrt(float(np.sum(kernel**2))), "valid")
        place = random.uniform(-0.5, 0.5, int(turns[-1]) + 1)[turns] * course.record.count
        place = np.convolve(np.where(rests, place, 0.0), kernel / kernel.sum(), "same")[:n]
        shake = shake * course.blur + place
        v = course.v + np.gradient(shake, course.step)
        total += (model.friction(course.x + shake, v, course.step) - friction) ** 2
    window = np.ones(round(2 * memory) + 1)
    window /= window.sum()
    return np.asarray(np.convolve(total / _SHAKES, window, "same") * 2 * memory)
