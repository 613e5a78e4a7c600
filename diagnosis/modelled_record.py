"""One record in a diagnosis: signals, motion, and the law along it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_opening, median_filter, uniform_filter1d
from scipy.signal import lfilter, savgol_filter, welch

from ..records.record import Record
from ..records.resolution import fast_noise
from .drive import Drive, midway
from .weak_form import acceleration, averaged, between_samples, lagged

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_ROUGH = 0.1  # of the friction: what may be left of an encoder's error in a window
_SHOWN = 0.05  # of the friction: what a position's noise may make of the force in a window
_SHORTEST, _SHORT, _LONGEST = 2e-4, 1e-3, 0.02  # spacing of the windows [s]
_OF_BAND = 0.35  # of the period that a position carries: shorter windows see a filter
_MOST_WINDOWS = 10_000
_SHAKES = 4  # draws that tell how an uncertain motion blurs the law
_AROUND = 5  # windows
_FALLS = 4.0  # powers of ten within an octave, that only a filter makes
_LONGEST_REST = 0.05  # beyond which samples tell nothing [s]
_SLOW = 3e-3  # of the record's fast speeds: slower is rest
_OFFSET = 0.1  # of its root mean square: a current sensor's standard deviation
_OFFSETS = "offset."  # names of the records' own
_ANSWERS = 1.0  # time constants in an interval, from which on samples hide how a speed answers
_OWN_OFFSET = 0.5  # of the friction, that a record's own offset may be


@dataclass(frozen=True)
class ModelledRecord:
    """A record with its motion and what the law says along it.

    Attributes
    ----------
    record : Record
    width : int
        Spacing of the windows, and quarter of the length of one, in samples.
    resistance : float
        As prior: balances are told in its terms [Ohm].
    x, v, i : ndarray, shape (n,)
        Smoothed motion and the current [m, m/s, A]; `i` is zero without a motor.
    bristle : ndarray, shape (n,)
        The law's force without its viscous part and offset, on average over the interval after
        each sample [N].
    unknown : ndarray, shape (n,)
        Force that opposes the motion and that the model does not have [N].
    force_variance : ndarray, shape (windows,)
        Variance of the law's force that the error of the motion makes [N^2].
    calibration : mapping of str to float
        What the instruments are off by, as far as it is known: ``command_shift`` in sampling
        intervals, ``current_offset`` [A] of what is read, ``current_gain``, the share by which the
        true current is larger, ``current_jump``, the share of a voltage's jump that a sample at its
        time has already, ``fast_speed``, whether the speed follows a held command within an
        interval, see `inner_a`.
    answers : float
        By how much the drive's speed is faster than the sampling, as prior: the interval over the
        speed's time constant.
    offset_name : str
        Under which `calibration` has the force [N] by which this record's offset is another than
        the first record's; empty where all have one.
    per_command : float
        Force that a lasting command holds at rest, as prior: balances are told in its terms [N/V].
    by_current : bool
        Whether the motor's force is taken from the current, else from the voltage and the mean
        speed: where the speed follows the voltage within a sampling interval, no sample shows the
        currents in between.
    """

    record: Record
    width: int
    resistance: float
    x: Vector
    v: Vector
    i: Vector
    bristle: Vector
    unknown: Vector
    force_variance: Vector
    calibration: Mapping[str, float] = field(default_factory=dict)
    by_current: bool = False
    offset_name: str = ""
    per_command: float = 1.0
    answers: float = 0.0

    @property
    def step(self) -> float:
        return self.record.step

    @property
    def has_current(self) -> bool:
        return "i" in self.record.signals

    @property
    def channels(self) -> tuple[str, ...]:
        """Balances that the record can fill: of forces, and of voltages where `i` is known."""
        return ("force", "voltage") if self.has_current else ("force",)

    @property
    def time(self) -> Vector:
        """From the record's start [s]."""
        return np.asarray(self.record.time - self.record.time[0])

    @property
    def own_offset(self) -> float:
        """Force by which this record's offset is another than the first record's [N]."""
        return self.calibration.get(self.offset_name, 0.0)

    @cached_property
    def slowest(self) -> float:
        """Speed below which a motion cannot be distinguished from rest [m/s]."""
        least = 2.0 * position_noise(self.record) / _LONGEST_REST
        return max(_SLOW * float(np.quantile(np.abs(self.v), 0.95)), least)

    @cached_property
    def rests(self) -> npt.NDArray[np.bool_]:
        """Where the drive rests for long, shape (n,): any force below break-away may act there."""
        slow = np.abs(self.v) < self.slowest
        length = max(round(_LONGEST_REST / self.step), 2)
        return np.asarray(binary_opening(slow, np.ones(length, dtype=bool)))

    @cached_property
    def resting(self) -> Vector:
        """Share of each window in which the drive rests for long, shape (windows,)."""
        return averaged(self.rests.astype(float), self.width)

    @cached_property
    def moved_v(self) -> Vector:
        """Velocity as the recorded positions have it, on average over each interval, shape (n,)."""
        moved = np.diff(self.record.x) / self.step
        return np.append(moved, moved[-1])

    @cached_property
    def measured_a(self) -> Vector:
        """Acceleration as the recorded positions have it, in each window, shape (windows,)."""
        return acceleration(self.record.x, self.step, self.width)

    @cached_property
    def inner_a(self) -> Vector:
        """What a speed that answers within an interval adds to `measured_a`, shape (windows,).

        Forces are averages over an interval, and so count as if they were the same all over it;
        then the acceleration is the difference of the speeds at the interval's ends. Where the
        command is held, the speed goes exponentially to its end, and the mean speed tells it.
        """
        kept = math.exp(-self.answers)
        mean = (1.0 - kept) / self.answers
        back = kept - (1.0 - kept) * mean / (1.0 - mean)
        moved = self.moved_v
        gain = (1.0 - kept) / (1.0 - mean)
        end, _ = lfilter([gain], [1.0, -back], moved, zi=[back * moved[0]])
        change = np.diff(end, prepend=moved[0]) / self.step
        return np.asarray(averaged(change, self.width) - self.measured_a)

    @cached_property
    def next_change(self) -> Vector:
        """By how much the next sample's command is another one, shape (n,)."""
        return np.append(self.u[1:], self.u[-1]) - self.u

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


def position_noise(record: Record) -> float:
    """Standard deviation of a position's reading [m]."""
    return max(record.resolution / math.sqrt(12.0), fast_noise(record.x), 1e-12)


class CalibrationPrior(NamedTuple):
    """How far an instrument may be off: a spread, and what is beyond belief."""

    spread: float
    low: float
    high: float


def calibration_priors(course: ModelledRecord) -> dict[str, CalibrationPrior]:
    """What the instruments may be off by, under the names of `ModelledRecord.calibration`.

    A command acts from where it is written, or half an interval to either side of it; of a jump of
    the voltage, a sample of the current at its time has nothing yet, or all.
    """
    found = {"command_shift": CalibrationPrior(0.4, -0.6, 0.6)}
    if course.answers > _ANSWERS:
        found["fast_speed"] = CalibrationPrior(0.7, -0.2, 1.4)
    if course.has_current:
        offset = _OFFSET * float(np.sqrt(np.nanmean(course.record.signals["i"] ** 2)))
        found["current_offset"] = CalibrationPrior(offset, -3.0 * offset, 3.0 * offset)
        found["current_gain"] = CalibrationPrior(0.03, -0.06, 0.06)
        found["current_jump"] = CalibrationPrior(0.4, 0.0, 1.0)
    own = [n for n in course.calibration if n.startswith(_OFFSETS)]
    if own:
        most = _OWN_OFFSET * float(np.sqrt(np.mean(course.bristle**2)))
        found |= dict.fromkeys(own, CalibrationPrior(0.5 * most, -most, most))
    return found


def with_own_offsets(courses: Sequence[ModelledRecord], model: Drive) -> list[ModelledRecord]:
    """The courses of a drive with an offset for each record after the first.

    Between records an amplifier drifts, and a cable or a slope pulls otherwise.
    """
    if model.has_motor:
        return list(courses)
    names = ["", *(f"{_OFFSETS}{k + 1}" for k in range(1, len(courses)))]
    zeros = dict.fromkeys(names[1:], 0.0)
    return [
        replace(c, calibration={**c.calibration, **zeros}, offset_name=name)
        for c, name in zip(courses, names, strict=True)
    ]


def lay_along(record: Record, model: Drive) -> ModelledRecord:
    """Smooth the motion and follow the law along it."""
    noise = position_noise(record)
    # noise of the second difference of smeared positions, times what moves, against the friction
    share = model.inertia * noise * math.sqrt(record.step) / (_SHOWN * model.friction_scale)
    spacing = (math.sqrt(8.0 / 3.0) * share) ** 0.4
    # long enough for the drive to have answered, short enough to see it answer
    answers = model.inertia / max(model.damping, 1e-9)
    least = min(max(answers, _SHORTEST), _SHORT)
    spacing = min(max(spacing, least, _OF_BAND / carried(record)), _LONGEST)
    width = max(round(spacing / record.step), -(-len(record.x) // _MOST_WINDOWS), 1)
    while width * record.step < _LONGEST and _rough(record, width, model) > _ROUGH:
        width = math.ceil(1.2 * width)
    x, v = _smoothed(record.x, width, record.step)
    nothing = np.zeros(len(x))
    current = _current(record, v, model)
    resistance = model.values["R"] if model.has_motor else 0.0
    course = ModelledRecord(record, width, resistance, x, v, current, nothing, nothing, nothing)
    course = replace(course, answers=record.step * model.damping / model.inertia)
    course = replace(
        course,
        per_command=model.per_command,
        calibration=dict.fromkeys(calibration_priors(course), 0.0),
    )
    return replace(
        with_law_force(course, model), force_variance=_force_variance(course, model, noise)
    )


def _smoothed(x: Vector, width: int, step: float) -> tuple[Vector, Vector]:
    """Position and velocity of positions that have noise."""
    window = min(4 * width + 1, len(x) // 2 * 2 - 1)
    return savgol_filter(x, window, 3), savgol_filter(x, window, 3, deriv=1, delta=step)


def shaken(course: ModelledRecord, random: np.random.Generator) -> ModelledRecord:
    """The course with its smoothed motion as the encoder would have read it another time."""
    noise = position_noise(course.record) * random.standard_normal(len(course.x))
    x, v = _smoothed(noise, course.width, course.step)
    return replace(course, x=course.x + x, v=course.v + v)


def read_anew(course: ModelledRecord, model: Drive, random: np.random.Generator) -> ModelledRecord:
    """The course as its instruments, each with its noise, would have read it another time.

    The smoothed motion, along which the law is followed, stays: its error is `force_variance`.
    """
    record = course.record
    white = random.standard_normal((2, len(record.x)))
    read = {"x": record.x + position_noise(record) * white[0]}
    if course.has_current:
        read["i"] = record.signals["i"] + _current_noise(course) * white[1]
    record = replace(record, signals={**record.signals, **read})
    return replace(course, record=record, i=_current(record, course.v, model))


def _rough(record: Record, width: int, model: Drive) -> float:
    """Force that no motion has, from one window to the next, relative to the friction.

    An interpolating encoder's error swings with the place: no noise of single readings shows it.
    """
    bent = np.diff(model.inertia * acceleration(record.x, record.step, width), 4)
    # a fourth difference of white noise is larger by the root of 70, and by 1.4 as bells overlap
    usual = 1.48 * float(np.median(np.abs(bent))) if len(bent) else 0.0
    return usual / (1.4 * math.sqrt(70.0) * model.friction_scale)


def _current_noise(course: ModelledRecord) -> float:
    """Standard deviation of a current's reading [A]."""
    step = float(np.median(np.abs(np.diff(np.unique(course.i))))) if len(course.i) > 1 else 0.0
    return max(fast_noise(course.i), step / math.sqrt(12.0))


def driven_by_current(course: ModelledRecord) -> ModelledRecord:
    """The course with the motor's force taken from the current."""
    return replace(course, by_current=True)


def _force_variance(course: ModelledRecord, model: Drive, noise: float) -> Vector:
    """Variance of the law's force that the error of the motion makes, shape (windows,) [N^2].

    The motion is uncertain by its noise, and by what smoothing it over twice the time changes.
    """
    random = np.random.default_rng(0)
    n, width = len(course.x), course.width
    window = min(8 * width + 1, n // 2 * 2 - 1)
    smoother = savgol_filter(course.record.x, window, 3)
    blur = np.hypot(noise / math.sqrt(width), smoother - course.x)
    known = averaged(model.friction(course.x, course.v, course.step), width)
    total = np.zeros(len(known))
    for _ in range(_SHAKES):
        shake = savgol_filter(random.standard_normal(n), window, 3) * math.sqrt(width) * blur
        v = course.v + np.gradient(shake, course.step)
        total += (averaged(model.friction(course.x + shake, v, course.step), width) - known) ** 2
    # its running sums can end below zero
    return np.asarray(np.maximum(uniform_filter1d(total / _SHAKES, _AROUND), 0.0))


def carried(record: Record) -> float:
    """Frequency up to which a position tells anything [Hz]; half the sampling rate where all does.

    What an encoder reads has a floor of rounding at all frequencies; where the spectrum falls far
    below it within less than an octave, a filter went over the position.
    """
    bent = np.diff(record.x, 2)
    frequency, power = welch(bent, 1.0 / record.step, nperseg=min(512, len(bent)))
    level = np.log10(median_filter(power[1:], 9) + 1e-300)
    octave = len(level) // 2
    for k in range(len(level) // 16, octave):
        if level[k] - np.max(level[2 * k :]) > _FALLS:
            return float(frequency[k + 1])
    return float(frequency[-1])


def _current(record: Record, v: Vector, model: Drive) -> Vector:
    """The motor's current at the samples, measured or as the voltage makes it [A]."""
    if not model.has_motor:
        return np.zeros(len(v))
    if "i" in record.signals:
        read = record.signals["i"]
        known = np.isfinite(read)
        return np.interp(record.time, record.time[known], read[known])
    resistance = model.values["R"]
    goal = (record.u - model.back_emf * v) / resistance
    late = lagged(goal[:, None], record.step, model.values["L"] / resistance)[:, 0]
    return np.append(late[:1], late[:-1])


def with_law_force(course: ModelledRecord, model: Drive) -> ModelledRecord:
    """The course with the law's force along it."""
    friction = model.friction(course.x, course.v, course.step)
    offset = 0.0 if model.has_motor else model.values["offset"]
    return replace(course, bristle=friction - offset)


def opposing(course: ModelledRecord, model: Drive) -> Vector:
    """The law's whole force along the course, on average over each interval, shape (n,) [N]."""
    law = model.friction(course.x, course.v, course.step)
    return law + model.linear_friction * course.middle_v


def true_current(course: ModelledRecord) -> Vector:
    """What the reading says of the current at the samples, before the voltage jumps, (n,) [A]."""
    gain = 1.0 + course.calibration["current_gain"]
    return np.asarray(gain * (course.i - course.calibration["current_offset"]))


def mean_current(course: ModelledRecord, model: Drive) -> Vector:
    """The true current, on average over the interval after each sample, shape (n,) [A]."""
    resistance = model.values["R"]
    jumps = np.diff(course.u, prepend=course.u[0]) / resistance
    # of a jump, the sample may have a share already
    had = course.calibration["current_jump"] * jumps
    slowed = max(model.damping, 1e-12)
    return between_samples(
        true_current(course) - had,
        jumps,
        course.step,
        model.values["L"] / resistance,
        model.inertia / slowed,
    )
