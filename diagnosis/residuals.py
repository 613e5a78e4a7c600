"""What a model leaves unexplained, in force and in position, against what instruments can show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from ..records.bad_record import BadRecord
from .balance import Added
from .drive_model import DriveModel
from .modelled_record import ModelledRecord, read_anew, sluggishness, voltage_scale
from .regression import ORDER, balance, telling
from .weak_form import centres

Vector = npt.NDArray[np.float64]

_FEWEST = 50  # windows in motion, that an autoregression and a model's values are fitted to
AHEAD = 1.0  # over which a position is predicted from a known state [s]


@dataclass(frozen=True)
class Residual:
    """Of one study, its records end to end.

    Attributes
    ----------
    force : ndarray, shape (n,)
        Force that acts against motion in +x and that the model does not have [N].
    by_current : ndarray, shape (n,)
        By how much the motor's force by the voltage is more than by the current [N]; zero where
        no current is known.
    position : ndarray, shape (n,)
        By how much a position predicted from the state at the start of each second is wrong [m].
    telling : ndarray of bool, shape (n,)
        Samples that count.
    """

    force: Vector
    by_current: Vector
    position: Vector
    telling: npt.NDArray[np.bool_]

    @property
    def force_rms(self) -> float:
        return rms(self.force[self.telling])

    @property
    def by_current_rms(self) -> float:
        return rms(self.by_current[self.telling])

    @property
    def position_rms(self) -> float:
        return rms(self.position)


def rms(values: Vector) -> float:
    """Root mean square; zero of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def check_motion(courses: Sequence[ModelledRecord]) -> None:
    """Refuse records that show next to no motion.

    Raises
    ------
    BadRecord
    """
    count, all_there = (
        int(sum(telling(c).sum() for c in courses)),
        sum(len(c.resting) for c in courses),
    )
    if count < _FEWEST:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(
            f"{names}: only {count} of {all_there} parts of {courses[0].width} samples show a "
            f"motion, expected {_FEWEST} at least: x rests, jumps from sample to sample or is noise"
        )


def residual(courses: Sequence[ModelledRecord], model: DriveModel, added: Added) -> Residual:
    """The unknown force that each record asks for, and what it does to a prediction.

    Parameters
    ----------
    model : DriveModel
        With the values to be judged.
    added : Added
        What is in the model beside its own equations.
    """
    parts = []
    for c, force, command in zip(courses, added.force, added.command, strict=True):
        law = model.friction(c.x, c.v, c.step)
        left = balance(c, model, law, force, command)
        # as a force, not as what it moves the prior model by
        whole = left[:, 0] * sluggishness(c, model) / c.inertia
        between = np.zeros(len(whole))
        if c.has_current:
            between = model.per_command * left[:, 1] / voltage_scale(c, model)
        if c.by_current:  # a simulation is given the voltage
            whole = whole + between
        found = at_samples(c, whole)
        moves = at_samples(c, c.resting) == 0.0
        parts.append((found, at_samples(c, between), _ahead(model, found, c.step), moves))
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def after_the_start(found: Residual, courses: Sequence[ModelledRecord]) -> Residual:
    """The residual without each record's start: what went on in the winding before is not known."""
    known = [np.arange(len(c.x)) >= (ORDER + 2) * c.width for c in courses]
    return replace(found, telling=found.telling & np.concatenate(known))


def floor(courses: Sequence[ModelledRecord], model: DriveModel) -> Residual:
    """What rounding and noise of the instruments leave by themselves: what reading anew changes.

    The law's error along a motion that is not known better, see `force_variance`, is not in it.
    """
    random = np.random.default_rng(0)
    nothing = Added.nothing(courses)
    once = residual(courses, model, nothing)
    again = residual([read_anew(c, model, random) for c in courses], model, nothing)
    return Residual(
        again.force - once.force,
        again.by_current - once.by_current,
        again.position - once.position,
        once.telling,
    )


def repetition(found: Residual, courses: Sequence[ModelledRecord], laps: Sequence[float]) -> float:
    """By how much what is left differs from one lap to the next, root mean square [N].

    Half of the mean square of the difference is each lap's own.
    """
    squares, at = [], 0
    for c, length in zip(courses, laps, strict=True):
        n, later = len(c.x), round(length / c.step)
        force, keep = found.force[at : at + n], found.telling[at : at + n]
        both = keep[later:] & keep[:-later]
        squares.append(0.5 * (force[later:] - force[:-later])[both] ** 2)
        at += n
    return rms(np.sqrt(np.concatenate(squares)))


def at_samples(course: ModelledRecord, values: Vector) -> Vector:
    """What is known in windows, shape (windows,), at the samples, shape (n,)."""
    return np.interp(np.arange(len(course.x)), centres(len(course.x), course.width), values)


def _ahead(model: DriveModel, force: Vector, step: float) -> Vector:
    """Error of the position that comes of not knowing a force, from nothing at every second."""
    every = max(2, round(AHEAD / step))
    slowed = model.damping / model.inertia
    kept = math.exp(-slowed * step)
    gained = step if slowed * step < 1e-9 else -math.expm1(-slowed * step) / slowed
    out = np.zeros(len(force))
    for first in range(0, len(force), every):
        part = force[first : first + every] / model.inertia
        speed = lfilter([0.0, gained], [1.0, -kept], part)
        # between two samples the speed goes from one value to the next
        moved = np.cumsum(0.5 * (speed[1:] + speed[:-1])) * step
        out[first + 1 : first + len(part)] = moved
    return out
