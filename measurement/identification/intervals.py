"""The most likely parameters of a law, the interval of each, and why it is not identified."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Matrix, Vector
from .fitted_law import FittedLaw

CONFIDENCE = 0.95
NARROW = 0.3  # a parameter is identified if its interval is within this share of its value


@dataclass(frozen=True)
class Interval:
    """Value, standard error and 95 % confidence interval of one parameter."""

    value: float
    unit: str
    standard_error: float | None  # None if the data give none
    low: float | None  # None if the data give no bound
    high: float | None
    method: str
    identified: bool  # whether both ends are within the share `NARROW` of the value
    because: str = ""  # why it is not identified
    would_do: str = ""  # which trial would be enough; both are empty if it is identified

    def times(self, factor: float) -> Interval:
        """The interval in another unit: all numbers times a positive factor."""
        low, high = (None if b is None else b * factor for b in (self.low, self.high))
        return replace(self, value=self.value * factor, low=low, high=high)

    def plus(self, shift: float) -> Interval:
        """The interval with a number added to value and bounds."""
        low, high = (None if b is None else b + shift for b in (self.low, self.high))
        return replace(self, value=self.value + shift, low=low, high=high)


def is_narrow(value: float, low: float | None, high: float | None) -> bool:
    """Whether an interval is narrow enough for its value to be identified."""
    if low is None or high is None:
        return False
    return max(high - value, value - low) <= NARROW * abs(value)


@dataclass
class Fit:
    """The most likely parameters and their uncertainty."""

    law: FittedLaw
    coordinates: Vector  # shape (p,)
    delays: Vector  # of the force, shape (clocks,) [s]
    late: tuple[Interval, ...]  # delays by the records alone
    noise: float  # standard deviation of the force before rounding [N]
    information: Matrix  # expected, of p + clocks; unknowns of single records eliminated
    covariance: Matrix  # of the coordinates, shape (p, p)
    freedom: Vector  # degrees of freedom of Student's t, shape (p,)
    predicted: Vector  # force [N], shape (n,); the measured force if the law does not give one
    held_out: Vector  # force of each piece of the records by a fit without it [N], shape (n,)
    spoken: npt.NDArray[np.bool_]  # samples at which the law gives a force, shape (n,)
    hidden: Vector  # variance of the force by the motion between samples and its reconstruction
    intervals: dict[str, Interval] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters; mass and offset, if fitted, are the last."""
        return self.law.names + self.law.beside

    @property
    def values(self) -> dict[str, float]:
        values = self.law.values_at(self.coordinates)
        return {n: float(v) for n, v in zip(self.names, values, strict=True)}

    def share(self, force: Vector) -> float:
        """Share of the force [N] that is predicted where it was not used in the fit.

        One minus the root mean square of what is left, over that of the force around its mean.
        """
        forces, left = force[self.spoken], (force - self.held_out)[self.spoken]
        return 1.0 - float(np.sqrt(np.mean(left**2)) / max(np.std(forces), 1e-300))

    def draws(self) -> Matrix:
        """Parameters drawn from Student's t, shape (draws, p); the same every time."""
        random = np.random.default_rng(0)
        try:
            root = np.linalg.cholesky(self.covariance)
        except np.linalg.LinAlgError:  # rounded, where something is not known at all
            variances, axes = np.linalg.eigh(self.covariance)
            root = axes * np.sqrt(np.maximum(variances, 0.0))
        normal = random.standard_normal((4000, len(root))) @ root.T
        freedom = float(self.freedom.min())
        far = normal * np.sqrt(freedom / random.chisquare(freedom, (4000, 1)))
        logarithms = far[:, : len(root) - self.law.offset]
        np.clip(logarithms, -40.0, 40.0, out=logarithms)
        return self.law.values_at(self.coordinates + far)
