"""The smallest possible residual, and whether the residual is as small as that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bands import EDGES
from .diagnosis import Level
from .explained import Explained
from .held_out import laps_of
from .residuals import Residual, at_samples, floor, repetition

AT_FLOOR = 2.0  # a residual above this multiple of the floor is not explained


@dataclass(frozen=True)
class NoiseFloor:
    """Root mean square residuals due to noise, as in `Residual`.

    Attributes
    ----------
    force, by_current : float
        Force residuals [N].
    position : float
        Position residual within a second [m].
    repeated : bool
        Whether the floor is computed from laps of one motion.
    """

    force: float
    by_current: float
    position: float
    repeated: bool

    @property
    def level(self) -> Level:
        return Level(self.force, self.position)

    def told(self, channels: Sequence[str]) -> dict[str, float]:
        """Root mean square noise of each balance of a record, for `Diagnosis.noise`."""
        of = {"force": ("force_N", self.force), "voltage": ("voltage_N", self.by_current)}
        return dict(of[c] for c in channels)

    def has(self, left: Residual) -> bool:
        """Whether the residual on held-out data is noise: at most twice the floor in newtons."""
        return left.force_rms <= AT_FLOOR * self.force and self.has_current(left)

    def has_current(self, left: Residual) -> bool:
        """Whether voltage and current differ by no more than noise."""
        return left.by_current_rms <= AT_FLOOR * self.by_current


def noise_floor(found: Explained, left: Residual) -> NoiseFloor:
    """Differences between laps of one motion, or the white part of the residual without laps.

    The floor is at least the noise of readings. The error of the law due to the error of the motion
    is added.

    Parameters
    ----------
    found : Explained
    left : Residual
        Residual of the model with all named causes.
    """
    study = found.study
    courses, model = study.courses, study.model
    read = floor(courses, model)
    along = np.concatenate([at_samples(c, c.force_variance) for c in courses])[left.telling]
    law = math.sqrt(float(along.mean())) if len(along) else 0.0
    white = _white(found)
    laps = laps_of(courses)
    # slower noise is not included, because faults are slow too
    own = math.hypot(repetition(left, courses, laps), study.exact) if laps else white[0]
    forces = max(own, read.force_rms)  # rounding may be the same in every lap
    between = max([study.exact, read.by_current_rms, *white[1:]])
    return NoiseFloor(math.hypot(forces, law), between, read.position_rms, bool(laps))


def _white(found: Explained) -> list[float]:
    """Root mean square residual of each balance, if all bands had that of the quietest one [N]."""
    levels = np.sqrt(found.variance)
    channel = np.flatnonzero(found.study.bands.used) // (len(EDGES) - 1)
    return [float(levels[channel == c].min()) for c in np.unique(channel)]
