"""The smallest possible residual, and whether more than noise is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bands import EDGES
from .diagnosis import Level
from .held_out import laps_of
from .residuals import Residual, at_samples, floor, repetition
from .rule import NOISE, Explained

AT_FLOOR = 2.0  # a residual above this multiple of the floor is not explained
TELLS = 0.2  # share of the friction: records that hide a larger fault decide nothing


@dataclass(frozen=True)
class NoiseFloor:
    """Root mean square residuals due to noise, as in `Residual`."""

    force: float  # [N]
    by_current: float  # [N]
    position: float | None  # within a second [m]
    repeated: bool  # whether it is computed from laps of one motion

    @property
    def level(self) -> Level:
        return Level(self.force, self.position)

    def by_channel(self, channels: Sequence[str]) -> dict[str, float]:
        """Root mean square noise of each balance of a record, for `Diagnosis.noise`."""
        of = {"force": ("force_N", self.force), "voltage": ("voltage_N", self.by_current)}
        return dict(of[c] for c in channels)

    def has(self, left: Residual) -> bool:
        """Whether the residual on held-out data is noise: at most twice the floor in newtons."""
        return left.force_rms <= AT_FLOOR * self.force and self.has_current(left)

    def has_current(self, left: Residual) -> bool:
        """Whether voltage and current differ by no more than noise."""
        return left.by_current_rms <= AT_FLOOR * self.by_current


@dataclass(frozen=True)
class Remainder:
    """What is left on held-out data; all verdicts rest on it.

    More than noise is left if a hypothesis is found, voltage and current contradict each other, or
    laps of one motion differ by less.
    """

    something: bool
    unseen: float  # largest fault that these records would not show, as a share of the friction
    doubtful: bool  # a score is between noise and what is found, and nothing is built in

    @property
    def hidden(self) -> bool:
        return self.unseen >= TELLS


def remainder(found: Explained, left: Residual, lowest: NoiseFloor, friction: float) -> Remainder:
    """Judge the residual `left` on held-out data, with the causes found in the model."""
    something = bool(found.sets[-1]) or not lowest.has_current(left)
    something = something or (lowest.repeated and not lowest.has(left))
    doubtful = found.best is not None and found.best.score > NOISE and not found.built
    unseen = max(AT_FLOOR * lowest.force, left.force_rms) / friction
    return Remainder(something, unseen, doubtful)


def noise_floor(found: Explained, left: Residual, position: float | None = None) -> NoiseFloor:
    """Differences between laps of one motion, or the white part of the residual without laps.

    The floor is at least the noise of readings. The error of the law due to the error of the motion
    is added. `left` is the residual of the model with all causes.
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
    return NoiseFloor(math.hypot(forces, law), between, position, bool(laps))


def _white(found: Explained) -> list[float]:
    """Root mean square residual of each balance, if all bands had that of the quietest one [N]."""
    levels = np.sqrt(found.variance)
    channel = np.flatnonzero(found.study.bands.used) // (len(EDGES) - 1)
    return [float(levels[channel == c].min()) for c in np.unique(channel)]
