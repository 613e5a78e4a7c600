"""Results of one friction law in the experiments of Section 2.4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


# -- observed quantities -------------------------------------------------------------------------


@dataclass(frozen=True)
class Peak:
    """Friction of a block loaded until it slides, in the direction of the load.

    Attributes
    ----------
    force : float or None
        Largest friction before it falls [N]; None: it never falls.
    sliding : float
        Smallest friction afterwards [N]; without a peak, the last one.
    """

    force: float | None
    sliding: float


@dataclass(frozen=True)
class ForceStep:
    """One trial of Table 2.10: reference force [N], motion of the block in the last second [m]."""

    asked: float
    last_second: float

    @property
    def slides(self) -> bool:
        """Whether it keeps moving: more than 10 um in the last second."""
        return abs(self.last_second) > 1e-5


@dataclass(frozen=True)
class ForceCurve:
    """Force [N] on the block and its displacement [m] over time [s], arrays of one shape."""

    time: Vector
    force: Vector
    x: Vector


@dataclass(frozen=True)
class Observations:
    """Results of one law in the five experiments of Section 2.4.

    Attributes
    ----------
    law : str
    parameters : dict of str to float
        Parameters of the friction law.
    forwards, backwards : Peak
        Slow loading in each direction.
    steps : list of ForceStep
        Table 2.10.
    speed, friction : ndarray, shape (60,)
        Mean velocity [m/s] and friction [N] in the second half of the constant velocities.
    loop_speed, loop_friction : ndarray, shape (k,)
        One cycle of Table 2.11 [m/s], [N], the mean of the last eight without jitter; closed.
    rates, rate_peaks : ndarray, shape (20,)
        Loading rates [N/s] and break-away forces [N]; NaN where friction does not peak.
    staircase : Course
        Presliding.
    hold_ends : ndarray, shape (3,) of int
        Indices of the ends of the holds.
    step : Course
        Step of the motor's force to 1.5 N.
    notes : list of str
        Instruments out of range, or the screw.
    """

    law: str
    parameters: dict[str, float]
    forwards: Peak
    backwards: Peak
    steps: list[ForceStep]
    speed: Vector
    friction: Vector
    loop_speed: Vector
    loop_friction: Vector
    rates: Vector
    rate_peaks: Vector
    staircase: ForceCurve
    hold_ends: npt.NDArray[np.int_]
    step: ForceCurve
    notes: list[str]
