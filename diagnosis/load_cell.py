"""A load cell between screw and block for validation: it is not used for the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .drive import Drive
from .modelled_record import ModelledRecord, opposing
from .residuals import rms

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ValidationSignal:
    """Root mean square difference between a load cell and the models' predictions of it [N]."""

    prior: float
    corrected: float


def foretold(course: ModelledRecord, model: Drive, more: Vector) -> Vector:
    """Force that drags the block, at the samples, shape (n,) [N].

    Parameters
    ----------
    more : ndarray, shape (n,)
        Forces that oppose the block's motion in addition to the law, as means over the interval
        after each sample [N].
    """
    between = opposing(course, model) + more + model.values["m"] * course.mean_a
    return np.asarray(0.5 * (between + np.append(between[0], between[:-1])))


def validation_signal(
    courses: Sequence[ModelledRecord],
    prior_model: Drive,
    corrected: Drive,
    more: Sequence[Vector],
) -> ValidationSignal | None:
    """Errors of both models' predictions of the recorded ``force``; None if it cannot be compared.

    Parameters
    ----------
    more : sequence of ndarray, shape (n,)
        Forces of the named causes on the block's side of the cell, one array per record [N].
    """
    if not prior_model.has_motor:  # the position of a cell in a drive with one body is not known
        return None
    before, after = [], []
    for course, force in zip(courses, more, strict=True):
        if "force" in course.record.signals:
            read = course.record.signals["force"]
            known = np.isfinite(read)
            nothing = np.zeros(len(read))
            before.append((read - foretold(course, prior_model, nothing))[known])
            after.append((read - foretold(course, corrected, force))[known])
    if not before:
        return None
    return ValidationSignal(rms(np.concatenate(before)), rms(np.concatenate(after)))
