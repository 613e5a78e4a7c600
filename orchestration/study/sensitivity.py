"""Sensitivity of a controller's figure: regression on the runs that were made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivity:
    """Standardized regression coefficients of a figure's logarithm.

    Attributes
    ----------
    coefficients : dict of str to float
        By variation: change of the logarithm, in its standard deviations, for one standard
        deviation of the factor. The larger, the more it matters.
    explained : float
        Share of the variance that the linear model explains (R^2); if it is small, the coefficients
        have little meaning.
    """

    coefficients: dict[str, float]
    explained: float

    @property
    def foremost(self) -> str:
        """The variation that matters most; empty if there is none or the figure did not change."""
        if not self.coefficients or not self.explained > 0:
            return ""
        return max(self.coefficients, key=lambda name: abs(self.coefficients[name]))


def sensitivity(factors: Matrix, figure: Vector, names: list[str]) -> Sensitivity:
    """Regress the logarithm of a positive figure on factors, shape (runs, names).

    A. Saltelli et al., Global Sensitivity Analysis: The Primer (2008), section 1.2.5.
    """
    y = np.log(figure)
    spread, size = factors.std(axis=0), float(y.std())
    varied = [k for k in range(len(names)) if spread[k] > 0]
    if not varied or not size > 1e-12 or len(y) <= len(varied) + 1:
        return Sensitivity(dict.fromkeys(names, 0.0), 0.0)
    x = (factors[:, varied] - factors[:, varied].mean(axis=0)) / spread[varied]
    standard = (y - y.mean()) / size
    found, *_ = np.linalg.lstsq(x, standard, rcond=None)
    left = standard - x @ found
    coefficients = dict.fromkeys(names, 0.0)
    coefficients |= {names[k]: float(c) for k, c in zip(varied, found, strict=True)}
    return Sensitivity(coefficients, float(1 - np.mean(left**2)))
