"""Calibration of the capacitance sensor with the micrometer, for each trial (Section 2.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...plant.instruments.capacitance_sensor import PER_PICOFARAD

Vector = npt.NDArray[np.float64]

POINTS = np.arange(0.0, 75e-6, 10e-6)
"""Displacements at which the capacitance is measured [m]: 0 to 70 um in steps of 10 um."""
_STUDENT_95 = 2.5706  # two-sided, for the five degrees of freedom of eight points and a quadratic


@dataclass(frozen=True)
class Calibration:
    """A quadratic polynomial from capacitance to displacement, and its uncertainty.

    Attributes
    ----------
    coefficients : ndarray, shape (3,)
        c0, c1, c2 [m] in ``c0 + c1 C + c2 C^2`` with the capacitance C in pF.
    covariance : ndarray, shape (3, 3)
        Covariance of the coefficients [m^2], from the scatter about the fit.
    displacements, capacitances : ndarray, shape (8,)
        Readings of the micrometer [m] and of the sensor [F].
    residual : float
        Root mean square distance of the points to the fit [m], with its degrees of freedom.
    """

    coefficients: Vector
    covariance: npt.NDArray[np.float64]
    displacements: Vector
    capacitances: Vector
    residual: float

    def displacement(self, capacitance: npt.ArrayLike) -> Vector:
        """Displacement [m] for capacitances [F]."""
        return _powers(np.asarray(capacitance, dtype=float)) @ self.coefficients

    def uncertainty(self, capacitance: npt.ArrayLike) -> Vector:
        """Half width of the fit's 95 % interval [m] at capacitances [F]."""
        powers = _powers(np.asarray(capacitance, dtype=float))
        variance = np.einsum("...i,ij,...j->...", powers, self.covariance, powers)
        return np.asarray(_STUDENT_95 * np.sqrt(variance))

    @property
    def error(self) -> float:
        """Largest half width of the 95 % interval over the calibrated points [m]."""
        return float(self.uncertainty(self.capacitances).max())


def _powers(capacitance: Vector) -> npt.NDArray[np.float64]:
    relative = capacitance * PER_PICOFARAD
    return np.stack([np.ones_like(relative), relative, relative**2], axis=-1)


def calibrate(
    capacitance: npt.ArrayLike,
    displacements: npt.ArrayLike = POINTS,
) -> Calibration:
    """Fit the quadratic polynomial to measured points by least squares.

    Parameters
    ----------
    capacitance : array_like, shape (m,)
        Average capacitance at each point [F].
    displacements : array_like, shape (m,)
        The micrometer's displacement at each point [m].

    Returns
    -------
    Calibration
    """
    x, c = np.asarray(displacements, dtype=float), np.asarray(capacitance, dtype=float)
    powers = _powers(c)
    # Nearly equal columns lose digits, so orthogonalize them first.
    q, r = np.linalg.qr(powers)
    coefficients = np.linalg.solve(r, q.T @ x)
    rest = x - powers @ coefficients
    variance = float(rest @ rest) / (len(x) - 3)
    inverse = np.linalg.inv(r)
    return Calibration(coefficients, variance * inverse @ inverse.T, x, c, variance**0.5)
