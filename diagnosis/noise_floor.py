"""The least that any model could leave of records, and whether what is left is that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .balance import EXACT
from .diagnosis import Level
from .drive_model import DriveModel
from .modelled_record import ModelledRecord
from .regression import Noise
from .residuals import Residual, at_samples, floor, repetition

AT_FLOOR = 2.0  # times the floor: more is not explained


@dataclass(frozen=True)
class NoiseFloor:
    """Root mean squares of what noise leaves, as in `Residual`.

    Attributes
    ----------
    force, by_current : float
        [N]
    position : float
        Over a second [m].
    """

    force: float
    by_current: float
    position: float

    @property
    def level(self) -> Level:
        return Level(self.force, self.position)

    def has(self, left: Residual) -> bool:
        """Whether what is left, on data held out, is noise: at most twice the floor in newtons."""
        return left.force_rms <= AT_FLOOR * self.force and self.has_current(left)

    def has_current(self, left: Residual) -> bool:
        """Whether voltage and current differ by no more than noise."""
        return left.by_current_rms <= AT_FLOOR * self.by_current


def noise_floor(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    noise: Noise,
    left: Residual,
    laps: Sequence[float],
) -> NoiseFloor:
    """What laps of one motion differ by, else the white part of the noise; no less than readings.

    And the error of the law along a motion that is not known better.

    Parameters
    ----------
    noise : Noise
        Of what the model leaves; what drives it is its white part.
    left : Residual
        What the model leaves.
    laps : sequence of float
        How long each record's laps take [s]; empty where there are none.
    """
    read = floor(courses, model)
    along = np.concatenate([at_samples(c, c.force_variance) for c in courses])[left.telling]
    law = math.sqrt(float(along.mean()))
    if laps:  # no law is just right
        own = math.hypot(repetition(left, courses, laps), EXACT * model.friction_scale)
    else:  # what grows with the speed is not in it: a fault does, too
        own = float(noise.sizes[0])
    white = max(own, read.force_rms)  # rounding may be the same in every lap
    between = max([read.by_current_rms, *(model.per_command * noise.sizes[1:])])
    return NoiseFloor(math.hypot(white, law), float(between), read.position_rms)
