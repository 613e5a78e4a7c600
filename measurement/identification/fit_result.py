"""The most likely parameters of a law and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .fitted_law import MASS, FittedLaw
from .intervals import Interval

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DRAWN = ("bliman_sorine", "maxwell_slip")  # a parameter depends on several coordinates
_FARTHEST = 40.0  # largest distance of drawn coordinates from the fit


@dataclass
class Fit:
    """The most likely parameters and their uncertainty.

    Attributes
    ----------
    names : tuple of str
        Names of the fitted parameters; with ``_pos`` and ``_neg`` if the directions have separate
        parameters. Mass and offset, if fitted, are the last.
    coordinates : ndarray, shape (p,)
    delays : ndarray, shape (clocks,)
        Delays of the force [s].
    late : tuple of Interval
        Delays by the records alone, with their intervals.
    shifts : ndarray, shape (records,)
        Displacement of each record before its first sample [m].
    noise : float
        Standard deviation of the force before rounding [N].
    cost : float
        Minus the logarithm of likelihood and prior.
    information : ndarray, shape (p + clocks, p + clocks)
        Expected information, unknowns of single records eliminated.
    covariance : ndarray, shape (p, p)
        Covariance of the coordinates.
    freedom : ndarray, shape (p,)
        Degrees of freedom of Student's t.
    predicted : ndarray, shape (n,)
        Force along the records [N]; the measured force if the law does not give one.
    spoken : ndarray of bool, shape (n,)
        Samples at which the law gives a force.
    hidden : ndarray, shape (n,)
        Variance of the force due to motion between samples and to the reconstruction of the motion
        [N^2].
    """

    law: FittedLaw
    tied: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    coordinates: Vector
    delays: Vector
    late: tuple[Interval, ...]
    shifts: Vector
    noise: float
    cost: float
    information: Matrix
    covariance: Matrix
    freedom: Vector
    predicted: Vector
    spoken: npt.NDArray[np.bool_]
    hidden: Vector
    intervals: dict[str, Interval] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        values = self.law.values_at(self.coordinates)
        return {n: float(v) for n, v in zip(self.names, values, strict=True)}


def without_direction(name: str) -> str:
    """A parameter's name without its direction."""
    return name.removesuffix("_pos").removesuffix("_neg")


def fitted_names(law: FittedLaw, tied: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    units = tuple("kg" if n == MASS else "N" for n in law.beside)
    if tied:
        return law.parameters + law.beside, law.units + units
    return law.by_side + law.beside, law.units * 2 + units


def draw_coordinates(fit: Fit) -> Matrix:
    """Parameters drawn from Student's t around the fit, shape (draws, p); the same every time."""
    random = np.random.default_rng(0)
    try:
        root = np.linalg.cholesky(fit.covariance)
    except np.linalg.LinAlgError:  # rounded, where something is not known at all
        variances, axes = np.linalg.eigh(fit.covariance)
        root = axes * np.sqrt(np.maximum(variances, 0.0))
    normal = random.standard_normal((4000, len(root))) @ root.T
    freedom = float(fit.freedom.min())
    heavy = np.sqrt(freedom / random.chisquare(freedom, (4000, 1)))
    far = normal * heavy
    logarithms = far[:, : len(root) - fit.law.offset]
    np.clip(logarithms, -_FARTHEST, _FARTHEST, out=logarithms)
    return fit.law.values_at(fit.coordinates + far)
