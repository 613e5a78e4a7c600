"""What a model leaves unexplained, in force and in position, against what instruments can show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from .drive_model import DriveModel
from .modelled_record import ModelledRecord, position_noise
from .regression import Added, balance
from .weak_form import acceleration, centres

Vector = npt.NDArray[np.float64]

AHEAD = 1.0  # over which a position is predicted from a known state [s]


@dataclass(frozen=True)
class Residual:
    """Of one study, its records end to end.

    Attributes
    ----------
    force : ndarray, shape (n,)
        Force that acts against motion in +x and that the model does not have [N].
    position : ndarray, shape (n,)
        By how much a position predicted from the state at the start of each second is wrong [m].
    telling : ndarray of bool, shape (n,)
        Samples that count.
    """

    force: Vector
    position: Vector
    telling: npt.NDArray[np.bool_]

    @property
    def force_rms(self) -> float:
        return rms(self.force[self.telling])

    @property
    def position_rms(self) -> float:
        return rms(self.position)


def rms(values: Vector) -> float:
    """Root mean square; zero of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def residual(courses: Sequence[ModelledRecord], model: DriveModel, added: Added) -> Residual:
    """The unknown force that each record asks for, and what it does to a prediction.

    Parameters
    ----------
    model : DriveModel
        With the values to be judged.
    added : Added
        What is in the model beside its own equations.
    """
    forces, positions, telling = [], [], []
    for c, force, command in zip(courses, added.force, added.command, strict=True):
        law = model.friction(c.x, c.v, c.step)
        left = balance(c, model, law, force, command)
        whole = left[:, 0]
        if c.by_current:  # a simulation is given the voltage
            whole = whole + model.per_command * left[:, 1]
        found = at_samples(c, whole)
        forces.append(found)
        positions.append(_ahead(model, found, c.step))
        rests = np.interp(
            np.arange(len(c.x)),
            centres(len(c.x), c.width),
            c.resting,
        )
        telling.append(rests == 0.0)
    return Residual(np.concatenate(forces), np.concatenate(positions), np.concatenate(telling))


def floor(courses: Sequence[ModelledRecord], model: DriveModel) -> Residual:
    """What rounding and noise of the position leave by themselves."""
    random = np.random.default_rng(0)
    forces, positions, telling = [], [], []
    for c in courses:
        n = len(c.x)
        read = position_noise(c.record) * random.standard_normal(n)
        found = at_samples(c, model.inertia * acceleration(read, c.step, c.width))
        forces.append(found)
        positions.append(_ahead(model, found, c.step))
        telling.append(~c.rests)
    return Residual(np.concatenate(forces), np.concatenate(positions), np.concatenate(telling))


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
