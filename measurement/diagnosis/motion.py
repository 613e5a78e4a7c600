"""A record laid along a model: its smoothed motion, the law's force along it, its instruments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg, ndimage

from ...solver.arrays import Mask, Vector
from ..records.record import Record, fast_noise
from .model import Drive, midway
from .windows import acceleration, averaged, between_samples, carried_on, lagged, per_interval

_HIDDEN = 0.05  # largest force error in a window due to position noise, as a share of friction
_ROUGH = 0.1  # the same due to noise of speeds, or due to an interpolating encoder
_SHORT, LONGEST = 1e-3, 0.02  # spacing of the windows [s]
_MOST_WINDOWS = 10_000
_AROUND = 5  # windows or samples
_LONGEST_REST = 0.05  # rests longer than this give no forces [s]
_SLOW = 3e-3  # rest is slower than this share of the record's fast speeds
_OFFSETS = "offset."  # prefix of the names of the records' offsets


class CalibrationPrior(NamedTuple):
    """Spread of an instrument's error, and its limits."""

    spread: float
    low: float
    high: float


@dataclass(frozen=True)
class Course:
    """A record of n samples with its motion and the law's force along it.

    Forces oppose motion in +x, and are means over the interval after each sample. `calibration` has
    the known errors of the instruments, see `calibrations`: ``command_shift`` in sampling
    intervals; ``current_offset`` of the reading [A]; ``current_gain``, the share by which the true
    current is larger; ``current_jump``, the share of a voltage's jump that the current sample at
    the same time already has; ``fast_speed``, the weight of `inner_a`; and the offset of a record
    less that of the first one [N].

    If the speed follows the voltage within a sampling interval, the samples do not show the current
    in between: then `by_current` is false, and the motor's force is that of the voltage.
    """

    record: Record
    width: int  # spacing of the windows, and quarter of the length of one, in samples
    resistance: float  # prior value [Ohm]
    x: Vector  # smoothed [m]
    v: Vector  # smoothed [m/s]
    i: Vector  # current; zero without a motor [A]
    bristle: Vector  # the law's force without its viscous part and offset [N]
    unknown: Vector  # opposing force that is missing in the model [N]
    force_variance: Vector  # of the law's force due to the error of the motion, by window [N^2]
    added_force: Vector  # of causes, against motion in +x [N]
    added_u: Vector  # change of the command by causes, its unit
    calibration: Mapping[str, float] = field(default_factory=dict)
    by_current: bool = False
    offset_name: str = ""  # of this record's offset in `calibration`; empty if all have the same
    per_command: float = 1.0  # static force per unit of a constant command, prior value [N/V]
    answers: float = 0.0  # sampling interval over the time constant of the speed, by prior values
    jumps: tuple[int, ...] = ()  # samples before which x jumps faster than any force can move it

    @property
    def step(self) -> float:
        return self.record.step

    @property
    def u(self) -> Vector:
        return self.record.u

    @property
    def has_current(self) -> bool:
        """Whether there is a balance of voltages beside that of forces."""
        return "i" in self.record.signals

    @cached_property
    def time(self) -> Vector:
        """Time from the record's start [s]."""
        return np.asarray(self.record.time - self.record.time[0])

    @property
    def own_offset(self) -> float:
        """Offset of this record less that of the first record [N]."""
        return self.calibration.get(self.offset_name, 0.0)

    @cached_property
    def slowest(self) -> float:
        """Speed below which a motion cannot be distinguished from rest [m/s]."""
        least = 2.0 * position_noise(self.record) / _LONGEST_REST
        return max(_SLOW * float(np.quantile(np.abs(self.v), 0.95)), least)

    @cached_property
    def rests(self) -> Mask:
        """Samples in long rests, shape (n,); any force below break-away may act there."""
        slow, length = np.abs(self.v) < self.slowest, max(round(_LONGEST_REST / self.step), 2)
        return np.asarray(ndimage.binary_opening(slow, np.ones(length, bool)))

    @cached_property
    def silent(self) -> Mask:
        """Samples that give no forces, shape (n,): in long rests and around jumps."""
        out = self.rests.copy()
        for k in self.jumps:
            out[max(k - 2 * self.width, 0) : k + 2 * self.width] = True
        return out

    @cached_property
    def moved_v(self) -> Vector:
        """Mean velocity over each interval, from recorded positions, shape (n,)."""
        return per_interval(self.record.x) / self.step

    @cached_property
    def measured_a(self) -> Vector:
        """Mean acceleration in each window, from recorded positions, shape (windows,)."""
        return acceleration(self.record.x, self.step, self.width)

    @cached_property
    def inner_a(self) -> Vector:
        """Correction of `measured_a` for a speed that follows a held command within an interval.

        The mean acceleration is the difference of the speeds at the ends of the interval; they
        follow from its mean speed and the exponential approach. Shape (windows,).
        """
        kept = math.exp(-self.answers)
        mean = (1.0 - kept) / self.answers
        back = kept - (1.0 - kept) * mean / (1.0 - mean)
        moved, gain = self.moved_v, (1.0 - kept) / (1.0 - mean)
        change = np.diff(carried_on(moved[:1], gain * moved, back)) / self.step
        return np.asarray(averaged(change, self.width) - self.measured_a)

    @property
    def given_u(self) -> Vector:
        """The command with its calibrated shift and its change by causes, shape (n,)."""
        next_change = np.append(self.u[1:], self.u[-1]) - self.u
        shifted = self.u + self.calibration["command_shift"] * next_change
        return np.asarray(shifted + self.added_u)

    @cached_property
    def middle_x(self) -> Vector:
        """Position in the middle of the interval after each sample [m]."""
        return midway(self.x)

    @cached_property
    def middle_v(self) -> Vector:
        """Mean velocity over the interval after each sample [m/s]."""
        return midway(self.v)

    @property
    def mean_a(self) -> Vector:
        """Mean acceleration over the interval after each sample [m/s^2]."""
        return per_interval(self.v) / self.step

    @property
    def true_current(self) -> Vector:
        """Current at the samples, before the voltage jumps, by the calibrated reading, (n,) [A]."""
        gain = 1.0 + self.calibration["current_gain"]
        return np.asarray(gain * (self.i - self.calibration["current_offset"]))


def position_noise(record: Record) -> float:
    """Standard deviation of a position's reading [m]."""
    return max(record.resolution / math.sqrt(12.0), fast_noise(record.x), 1e-12)


def calibrations(course: Course) -> dict[str, CalibrationPrior]:
    """Priors of the instruments' errors, with the names of `Course.calibration`."""
    found = {"command_shift": CalibrationPrior(0.4, -0.6, 0.6)}
    if course.answers > 1.0:  # the interval is longer than the time constant of the speed
        found["fast_speed"] = CalibrationPrior(0.7, -0.2, 1.4)
    if course.has_current:
        offset = 0.1 * float(np.sqrt(np.nanmean(course.record.signals["i"] ** 2)))
        found["current_offset"] = CalibrationPrior(offset, -3.0 * offset, 3.0 * offset)
        found["current_gain"] = CalibrationPrior(0.03, -0.06, 0.06)
        found["current_jump"] = CalibrationPrior(0.4, 0.0, 1.0)
    if own := [n for n in course.calibration if n.startswith(_OFFSETS)]:
        most = 0.5 * float(np.sqrt(np.mean(course.bristle**2)))  # half of the friction
        found |= dict.fromkeys(own, CalibrationPrior(0.5 * most, -most, most))
    return found


def recalibrated(courses: Sequence[Course], changes: Mapping[str, float]) -> list[Course]:
    """Return the courses with their calibrations changed by `changes`."""
    known = [{n: v + changes.get(n, 0.0) for n, v in c.calibration.items()} for c in courses]
    return [replace(c, calibration=own) for c, own in zip(courses, known, strict=True)]


def courses_of(records: Sequence[Record], model: Drive) -> list[Course]:
    """Records along a model; of a drive, each after the first has an offset, as of a cable."""
    courses = [lay_along(r, model) for r in records]
    if model.has_motor:
        return courses
    names = ["", *(f"{_OFFSETS}{k + 1}" for k in range(1, len(courses)))]
    zeros = dict.fromkeys(names[1:], 0.0)
    return [
        replace(c, calibration={**c.calibration, **zeros}, offset_name=name)
        for c, name in zip(courses, names, strict=True)
    ]


def lay_along(record: Record, model: Drive) -> Course:
    """Smooth the motion and follow the law along it."""
    width = _width(record, model)
    x, v = _smoothed(record.x, width, record.step)
    nothing, current = np.zeros(len(x)), _current(record, v, model)
    course = Course(
        *(record, width, model.values.get("R", 0.0), x, v, current, nothing, nothing),
        _force_variance(record, x, v, width, model),
        *(nothing, nothing),
        per_command=model.linear.per_command,
        answers=record.step * model.damping / model.linear.inertia,
    )
    errors = dict.fromkeys(calibrations(course), 0.0)
    course = replace(course, calibration=errors, jumps=_jumps(course, model))
    return with_law_force(course, model)


def _width(record: Record, model: Drive) -> int:
    """Samples between windows: long enough for the drive to respond, and for quiet positions."""
    # noise of second and first differences of averaged positions, as a force relative to friction
    share = position_noise(record) * math.sqrt(record.step) / model.friction_scale
    spacing = (math.sqrt(8.0 / 3.0) * model.linear.inertia * share / _HIDDEN) ** 0.4
    spacing = max(spacing, (math.sqrt(2.0 / 3.0) * model.damping * share / _ROUGH) ** (2.0 / 3.0))
    answers = model.linear.inertia / max(model.damping, 1e-9)
    spacing = min(max(spacing, min(answers, _SHORT)), LONGEST)
    width: int = max(round(spacing / record.step), -(-len(record.x) // _MOST_WINDOWS), 1)
    while width * record.step < LONGEST and _rough(record, width, model) > _ROUGH:
        width = math.ceil(1.2 * width)
    return width


def _jumps(course: Course, model: Drive) -> tuple[int, ...]:
    """Samples before which x jumps in motion, as by lost counts: the speed stays the same."""
    bent = np.diff(course.record.x, 2)
    first, second = bent[:-1], bent[1:]
    size = np.where(first * second < 0.0, np.minimum(np.abs(first), np.abs(second)), 0.0)
    speed = np.abs(np.diff(course.record.x)) / course.step
    moves = np.minimum(speed[:-2], speed[2:]) > course.slowest
    u = course.u
    swing = ndimage.maximum_filter1d(u, _AROUND)[1:-2] - ndimage.minimum_filter1d(u, _AROUND)[1:-2]
    swing = abs(model.linear.per_command) * swing + 2.0 * model.friction_scale
    possible = swing * course.step**2 / model.linear.inertia
    # a second difference has 6 times the variance; the largest of n normal values is nearly the
    # root of 2 ln n
    noise = math.sqrt(6.0 * 2.0 * math.log(len(u))) * position_noise(course.record)
    return tuple((np.flatnonzero(moves & (size > possible + noise)) + 2).tolist())


def jumps_of(courses: Sequence[Course]) -> Iterator[str]:
    """Notes on jumps of the position: the first of each record."""
    for c in courses:
        for k in c.jumps[:1]:
            size = 1e6 * float(np.diff(c.record.x[k - 2 : k + 1], 2)[0])
            yield (
                f"{c.record.name}: x jumps by {size:.3g} um within a sample at "
                f"{c.record.time[k]:.6g} s ({len(c.jumps)} in all), which no force of this drive "
                "can do: look for lost counts; the samples around are left out"
            )


def _smoothed(x: Vector, width: int, step: float) -> tuple[Vector, Vector]:
    """Smoothed position and velocity from noisy positions."""
    window = min(4 * width + 1, len(x) // 2 * 2 - 1)
    return _cubics(x, window), _cubics(x, window, 1, step)


def _cubics(values: Vector, window: int, slope: int = 0, step: float = 1.0) -> Vector:
    """Values or slopes of cubics, each fitted to the samples around (A. Savitzky and M. Golay)."""
    half, at = window // 2, np.arange(float(window))
    weights, *_ = linalg.lstsq((half - at) ** np.arange(4.0)[:, None], np.eye(4)[slope] / step)
    out = ndimage.convolve1d(values, weights, mode="constant")
    for whole, end in ((slice(window), slice(half)), (slice(-window, None), slice(-half, None))):
        cubic = np.polyder(np.polyfit(at, values[whole], 3), slope)
        out[end] = np.polyval(cubic, at[end]) / step
    return np.asarray(out)


def shaken(course: Course, random: np.random.Generator) -> Course:
    """The course with its smoothed motion as in another reading by the encoder."""
    noise = position_noise(course.record) * random.standard_normal(len(course.x))
    x, v = _smoothed(noise, course.width, course.step)
    return replace(course, x=course.x + x, v=course.v + v)


def read_anew(course: Course, model: Drive, random: np.random.Generator) -> Course:
    """The course with new noise of each instrument, but the same smoothed motion."""
    record, i = course.record, course.i
    white = random.standard_normal((2, len(record.x)))
    read = {"x": record.x + position_noise(record) * white[0]}
    if course.has_current:
        step = float(np.median(np.abs(np.diff(np.unique(i))))) if len(i) > 1 else 0.0
        noise = max(fast_noise(i), step / math.sqrt(12.0))
        read["i"] = record.signals["i"] + noise * white[1]
    record = replace(record, signals={**record.signals, **read})
    return replace(course, record=record, i=_current(record, course.v, model))


def _rough(record: Record, width: int, model: Drive) -> float:
    """Random change of the force between windows, as by an interpolating encoder, over friction."""
    bent = np.diff(model.linear.inertia * acceleration(record.x, record.step, width), 4)
    # a fourth difference of white noise is larger by the root of 70, and by 1.4 as bells overlap
    usual = 1.48 * float(np.median(np.abs(bent))) if len(bent) else 0.0
    return usual / (1.4 * math.sqrt(70.0) * model.friction_scale)


def _force_variance(record: Record, x: Vector, v: Vector, width: int, model: Drive) -> Vector:
    """Variance of the law's force due to noise and smoothing of the motion, (windows,) [N^2]."""
    random = np.random.default_rng(0)
    window = min(8 * width + 1, len(x) // 2 * 2 - 1)
    blur = np.hypot(position_noise(record) / math.sqrt(width), _cubics(record.x, window) - x)
    known = averaged(model.friction(x, v, record.step), width)
    shake = _cubics(random.standard_normal(len(x)), window) * math.sqrt(width) * blur
    faster = v + np.gradient(shake, record.step)
    change = averaged(model.friction(x + shake, faster, record.step), width) - known
    # rounding in the running sums can give values below zero
    return np.asarray(np.maximum(ndimage.uniform_filter1d(change**2, _AROUND), 0.0))


def _current(record: Record, v: Vector, model: Drive) -> Vector:
    """The motor's current at the samples, measured or computed from the voltage [A]."""
    if not model.has_motor:
        return np.zeros(len(v))
    if "i" in record.signals:
        read = record.signals["i"]
        known = np.isfinite(read)
        return np.interp(record.time, record.time[known], read[known])
    resistance = model.values["R"]
    goal = (record.u - model.linear.back_emf * v) / resistance
    late = lagged(goal, model.values["L"] / resistance, record.step)
    return np.append(late[:1], late[:-1])


def with_law_force(course: Course, model: Drive) -> Course:
    """The course with the law's force along it."""
    law = model.friction(course.x, course.v, course.step)
    return replace(course, bristle=law - model.values.get("offset", 0.0))


def opposing(course: Course, model: Drive) -> Vector:
    """The law's total force along the course, mean over each interval, shape (n,) [N]."""
    law = model.friction(course.x, course.v, course.step)
    return law + model.linear_friction * course.middle_v


def mean_current(course: Course, model: Drive) -> Vector:
    """The true current, mean over the interval after each sample, shape (n,) [A]."""
    resistance, slowed = model.values["R"], max(model.damping, 1e-12)
    jumps = np.diff(course.u, prepend=course.u[0]) / resistance
    had = course.calibration["current_jump"] * jumps  # the sample may already have a share of it
    times = model.values["L"] / resistance, model.linear.inertia / slowed
    return between_samples(course.true_current - had, jumps, course.step, *times)
