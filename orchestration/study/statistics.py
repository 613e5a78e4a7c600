"""Means with intervals, whether two controllers differ, and what a figure depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

LEVEL = 0.90
"""At most one study in ten calls equal controllers different."""
RELEVANT = 0.02
"""Smallest relevant difference of two figures: their ratio minus 1."""
ALIKE = 0.1
"""Equal figures have a ratio within this share of 1, by all of its interval."""


@dataclass(frozen=True)
class Mean:
    """A mean of a figure over plants, with its interval; NaN if a run has no such figure."""

    mean: float  # in the figure's unit
    low: float  # 90 % interval of it, over plants and their noise
    high: float
    geometric: bool  # whether it is the geometric mean


@dataclass(frozen=True)
class Difference:
    """How a figure of one controller compares with that of another."""

    ratio: float  # geometric mean of first over second
    low: float  # 90 % interval of it, over plants and tunings
    high: float
    told_apart: bool  # whether the interval contains no ratio within 2 % of 1
    # whether it contains only ratios within 10 % of 1. If neither, these runs cannot tell
    alike: bool

    @property
    def words(self) -> str:
        if self.told_apart:
            return "different"
        return f"equal within {100 * ALIKE:g} %" if self.alike else "these runs cannot tell"


def mean_over_plants(figure: Matrix, geometric: bool) -> Mean:
    """The mean of a figure over the drawn plants, each with its own noise.

    The figure is by tuning and plant, shape (seeds, plants). Student's interval over the plants, of
    the mean over tunings on each. For a positive figure (`geometric`) it is that of the logarithm:
    differences of plants mostly multiply an error, so that the logarithm is closer to normal, and
    two controllers are compared by it. The tunings are fixed: the scatter of other tunings is not
    included. A bootstrap needs no distribution, but with 20 plants it is too narrow (for a normal
    figure it contains the mean in 86 or 87 of 100 studies).
    """
    from scipy import stats

    if not np.isfinite(figure).all():
        return Mean(math.nan, math.nan, math.nan, geometric)
    by_plant = (np.log(figure) if geometric else figure).mean(axis=0)
    middle, count = float(by_plant.mean()), len(by_plant)
    half = float(stats.t.ppf((1 + LEVEL) / 2, count - 1)) * math.sqrt(_variance_of_mean(by_plant))
    mean, low, high = (
        math.exp(v) if geometric else v for v in (middle, middle - half, middle + half)
    )
    return Mean(mean, low, high, geometric)


def compare(first: Matrix, second: Matrix) -> Difference:
    """Compare a positive, finite figure of two controllers, shape (seeds, plants).

    The plants are the same for both, so that their differences are paired; tunings are not. The
    variance of the mean is the sum of that over plants and of those over the tunings of each, its
    degrees of freedom after Welch and Satterthwaite (B. L. Welch, Biometrika 34, 28 (1947)).
    """
    from scipy import stats

    a, b = np.log(first), np.log(second)
    paired = a.mean(axis=0) - b.mean(axis=0)
    parts = [(_variance_of_mean(paired), len(paired) - 1)]
    parts += [(_variance_of_mean(side.mean(axis=1)), len(side) - 1) for side in (a, b)]
    variance = sum(v for v, _ in parts)
    middle = float(paired.mean())
    if variance > 0:
        freedom = variance**2 / sum(v**2 / n for v, n in parts if n > 0)
        half = float(stats.t.ppf((1 + LEVEL) / 2, freedom)) * math.sqrt(variance)
    else:
        half = 0.0
    low, high = middle - half, middle + half
    margin = math.log1p(RELEVANT)
    told = low > margin or high < -margin
    alike = not told and max(high, -low) <= math.log1p(ALIKE)
    # an interval of two tunings may be wider than numbers go
    ratio, least, most = (math.exp(min(max(v, -700.0), 700.0)) for v in (middle, low, high))
    return Difference(ratio, least, most, told, alike)


def _variance_of_mean(values: Matrix) -> float:
    return float(np.var(values, ddof=1) / len(values)) if len(values) > 1 else 0.0


@dataclass(frozen=True)
class Sensitivity:
    """Standardized regression coefficients of a figure's logarithm."""

    # by variation: change of the logarithm, in its standard deviations, for one standard deviation
    # of the factor. The larger, the more it matters
    coefficients: dict[str, float]
    # share of the variance that the linear model explains (R^2); if it is small, the coefficients
    # have little meaning
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
