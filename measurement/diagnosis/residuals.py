"""Residuals of a model in force, compared with the errors of the instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...solver.arrays import Mask, Vector
from ...solver.errors import BadRecord
from .balance import Added, leftovers
from .bands import moving
from .drive import Drive
from .modelled_record import ModelledRecord, read_anew
from .weak_form import averaged, centres

_JUMP = 0.1  # jump of the law's force between two samples, as a share of friction
_BINS = 60
_LEAST_IN_BIN = 20
_FEWEST = 50  # smallest number of windows in motion to judge a model


@dataclass(frozen=True)
class Residual:
    """Residuals of one study, its records end to end, shape (n,)."""

    force: Vector  # opposes motion in +x and is missing in the model [N]
    by_current: Vector  # motor force by the voltage less that by the current, 0 without one [N]
    telling: Mask  # samples at which forces are known

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
    """Raise BadRecord for records with almost no motion."""
    count = int(sum(moving(c, model).sum() for c in courses))
    if count < _FEWEST:
        names, parts = (
            ", ".join(c.record.name for c in courses),
            sum(len(c.resting) for c in courses),
        )
        raise BadRecord(
            f"{names}: only {count} of {parts} parts of {courses[0].width} samples are in motion; "
            f"expected {_FEWEST} at least: x is constant, jumps from sample to sample or is noise"
        )


def residual(courses: Sequence[ModelledRecord], model: Drive, added: Added) -> Residual:
    """Force missing in a model and what is added to its equations, along each record.

    Forces are scaled to the prior model's force per unit of the command, see `balance`. At jumps of
    the law's force they are not known, because the instant within a sampling interval is not.
    """
    parts = []
    for c, left in zip(courses, leftovers(courses, model, added), strict=True):
        whole = at_samples(c, left[:, 0])
        between = at_samples(c, left[:, 1]) if c.has_current else np.zeros(len(whole))
        if c.by_current:  # the input of a simulation is the voltage
            whole = whole + between
        jumps = np.abs(np.diff(c.bristle, append=c.bristle[-1:]))
        steady = averaged(jumps, c.width) < _JUMP * model.friction_scale
        keep = at_samples(c, np.asarray(moving(c, model) * steady, dtype=float)) == 1.0
        parts.append((whole, between, keep))
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def floor(courses: Sequence[ModelledRecord], model: Drive) -> Residual:
    """Residual due to rounding and instrument noise alone: the change with a repeated reading.

    It does not include the law's error due to the error of the motion, see `force_variance`.
    """
    random = np.random.default_rng(0)
    nothing = Added.nothing(courses)
    once = residual(courses, model, nothing)
    again = residual([read_anew(c, model, random) for c in courses], model, nothing)
    between = again.by_current - once.by_current
    return Residual(again.force - once.force, between, once.telling)


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


def binned(x: Vector, y: Vector, keep: Mask, alike: bool = False) -> tuple[Vector, Vector]:
    """Means of y over parts of the range of x, NaN for parts with almost no samples.

    The parts have equal width or, with `alike`, equal numbers of samples, for speeds held constant.
    """
    if not np.any(keep) or np.ptp(x[keep]) == 0:
        return np.array([np.nan]), np.array([np.nan])
    if alike:
        order = np.flatnonzero(keep)[np.argsort(x[keep], kind="stable")]
        parts = np.array_split(order, min(2 * _BINS, max(1, len(order) // _LEAST_IN_BIN)))
        return np.array([x[k].mean() for k in parts]), np.array([y[k].mean() for k in parts])
    edges = np.linspace(x[keep].min(), x[keep].max(), _BINS + 1)
    place = np.clip(np.digitize(x[keep], edges) - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    total = np.bincount(place, weights=y[keep], minlength=_BINS)
    mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean
