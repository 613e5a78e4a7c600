"""Residuals of a model in force, compared with the errors of the instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .balance import Added, leftovers
from .bands import moving
from .drive import Drive
from .modelled_record import ModelledRecord, read_anew
from .weak_form import averaged, centres

_JUMP = 0.1  # jump of the law's force between two samples, as a share of friction
_FEWEST = 50  # smallest number of windows in motion to judge a model


@dataclass(frozen=True)
class Residual:
    """Residuals of one study, its records end to end.

    Attributes
    ----------
    force : ndarray, shape (n,)
        Force that opposes motion in +x and is missing in the model [N].
    by_current : ndarray, shape (n,)
        Motor force computed from the voltage less that from the current [N]; zero without a
        current.
    telling : ndarray of bool, shape (n,)
        Samples at which forces are known.
    """

    force: Vector
    by_current: Vector
    telling: npt.NDArray[np.bool_]

    @property
    def force_rms(self) -> float:
        return rms(self.force[self.telling])

    @property
    def by_current_rms(self) -> float:
        return rms(self.by_current[self.telling])


def rms(values: Vector) -> float:
    """Root mean square; zero for an empty array."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def check_motion(courses: Sequence[ModelledRecord], model: Drive) -> None:
    """Raise BadRecord for records with almost no motion.

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
    """Force missing in the model along each record.

    Forces are scaled to the prior model's force per unit of the command, see `balance`.

    Parameters
    ----------
    model : Drive
        The model, with the values to judge.
    added : Added
        Additions to the model's own equations.
    """
    parts = []
    for c, left in zip(courses, leftovers(courses, model, added), strict=True):
        whole = at_samples(c, left[:, 0])
        between = at_samples(c, left[:, 1]) if c.has_current else np.zeros(len(whole))
        if c.by_current:  # the input of a simulation is the voltage
            whole = whole + between
        keep = at_samples(c, _telling(c, model)) == 1.0
        parts.append((whole, between, keep))
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def _telling(course: ModelledRecord, model: Drive) -> Vector:
    """One for each window that gives forces, shape (windows,).

    Jumps of the law's force are excluded: their instant within a sampling interval is not known.
    """
    jumps = np.abs(np.diff(course.bristle, append=course.bristle[-1:]))
    steady = averaged(jumps, course.width) < _JUMP * model.friction_scale
    return np.asarray(moving(course, model) * steady, dtype=float)


def floor(courses: Sequence[ModelledRecord], model: Drive) -> Residual:
    """Residual due to rounding and instrument noise alone: the change with a repeated reading.

    It does not include the law's error due to the error of the motion, see `force_variance`.
    """
    random = np.random.default_rng(0)
    nothing = Added.nothing(courses)
    once = residual(courses, model, nothing)
    again = residual([read_anew(c, model, random) for c in courses], model, nothing)
    return Residual(
        again.force - once.force,
        again.by_current - once.by_current,
        once.telling,
    )


def repetition(found: Residual, courses: Sequence[ModelledRecord], laps: Sequence[float]) -> float:
    """Root mean square of the part of the residual that does not repeat from lap to lap [N].

    Each lap contributes half of the mean square of the difference.
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
    """Values in windows, shape (windows,), interpolated at the samples, shape (n,)."""
    return np.interp(np.arange(len(course.x)), centres(len(course.x), course.width), values)
