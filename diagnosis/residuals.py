"""Residuals of a model in force and in position, compared with the errors of the instruments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from ..records.bad_record import BadRecord
from .balance import Added, leftovers
from .bands import moving
from .drive import Drive
from .modelled_record import ModelledRecord, read_anew
from .weak_form import averaged, centres

Vector = npt.NDArray[np.float64]

_JUMP = 0.1  # of the friction, from one sample to the next
_FEWEST = 50  # windows in motion, that a model is judged on
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


def check_motion(courses: Sequence[ModelledRecord], model: Drive) -> None:
    """Refuse records that show next to no motion.

    Raises
    ------
    BadRecord
    """
    count, all_there = (
        int(sum(moving(c, model).sum() for c in courses)),
        sum(len(c.resting) for c in courses),
    )
    if count < _FEWEST:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(
            f"{names}: only {count} of {all_there} parts of {courses[0].width} samples are "
            f"in motion; expected {_FEWEST} at least: x is constant, jumps from sample to sample "
            "or is noise"
        )


def residual(courses: Sequence[ModelledRecord], model: Drive, added: Added) -> Residual:
    """The unknown force that each record asks for, and what it does to a prediction.

    Forces are told at the prior model's force per unit of the command, see `balance`.

    Parameters
    ----------
    model : Drive
        With the values to be judged.
    added : Added
        What is in the model beside its own equations.
    """
    parts = []
    for c, left in zip(courses, leftovers(courses, model, added), strict=True):
        whole = at_samples(c, left[:, 0])
        between = at_samples(c, left[:, 1]) if c.has_current else np.zeros(len(whole))
        if c.by_current:  # a simulation is given the voltage
            whole = whole + between
        keep = at_samples(c, _telling(c, model)) == 1.0
        parts.append((whole, between, _ahead(model, whole, c), keep))
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def _telling(course: ModelledRecord, model: Drive) -> Vector:
    """One for each window that tells of forces, shape (windows,).

    Where the law's force jumps, no sample tells when within its interval.
    """
    jumps = np.abs(np.diff(course.bristle, append=course.bristle[-1:]))
    steady = averaged(jumps, course.width) < _JUMP * model.friction_scale
    return np.asarray(moving(course, model) * steady, dtype=float)


def floor(courses: Sequence[ModelledRecord], model: Drive) -> Residual:
    """What rounding and noise of the instruments leave alone: the change by a repeated reading.

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


def _ahead(model: Drive, force: Vector, course: ModelledRecord) -> Vector:
    """Error of the position that comes of not knowing a force, from nothing at every second.

    At rest, friction balances all forces, and no error grows. `compare` tells what
    the model itself does there.
    """
    step = course.step
    slowed = model.damping / model.inertia
    kept = math.exp(-slowed * step)
    gained = step if slowed * step < 1e-9 else -math.expm1(-slowed * step) / slowed
    out = np.zeros(len(force))
    every = max(2, round(AHEAD / step))
    for first in range(0, len(force), every):
        part = slice(first, first + every)
        speed = np.zeros(len(force[part]))
        turns = np.flatnonzero(np.diff(course.rests[part], prepend=True, append=True))
        for begin, end in zip(turns[::2], turns[1::2], strict=True):
            pushed = force[part][begin:end] / model.inertia
            speed[begin:end] = lfilter([0.0, gained], [1.0, -kept], pushed)
        # between two samples the speed goes from one value to the next
        moved = np.cumsum(0.5 * (speed[1:] + speed[:-1])) * step
        out[first + 1 : first + len(speed)] = moved
    return out
