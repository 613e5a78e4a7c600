"""What a controller's figure depends on: regression on its runs, and Sobol indices by SALib."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.errors import UserError
from .comparison import LEVEL

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

RESAMPLES = 200  # of the bootstrap of the intervals


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


@dataclass(frozen=True)
class SobolIndex:
    """Share of the variance of a figure's logarithm that comes from one variation."""

    first: float  # alone; and with all its interactions with others
    first_within: float  # half the width of their 90 % intervals, by a bootstrap over the sample
    total: float
    total_within: float


def sobol_shares(count: int, inputs: int, seed: int) -> Matrix:
    """Points of the unit cube, shape (count (inputs + 2), inputs), in SALib's order.

    A scrambled sequence after Sobol in the scheme of A. Saltelli et al., Computer Physics
    Communications 181, 259 (2010). Raises `UserError` if SALib is not installed.
    """
    try:
        from SALib.sample import sobol
    except ImportError:
        raise UserError("sensitivity: sobol needs SALib: pip install 'ballscrew[sobol]'") from None
    points = sobol.sample(_problem(inputs), count, calc_second_order=False, seed=seed)
    return np.asarray(points, dtype=np.float64)


def sobol_indices(figure: Vector, names: list[str], seed: int) -> dict[str, SobolIndex]:
    """Indices of the logarithm of a positive figure at the points of `sobol_shares`, by name.

    Empty if a run has no such figure, all zero if it does not change.
    """
    from SALib.analyze import sobol

    if not np.isfinite(figure).all():
        return {}
    logarithm = np.log(figure)
    if not np.ptp(logarithm) > 1e-12:
        return {name: SobolIndex(0.0, 0.0, 0.0, 0.0) for name in names}
    found = sobol.analyze(
        _problem(len(names)),
        logarithm,
        calc_second_order=False,
        num_resamples=RESAMPLES,
        conf_level=LEVEL,
        seed=seed,
    )
    rows = zip(*(found[key].tolist() for key in ("S1", "S1_conf", "ST", "ST_conf")), strict=True)
    return {name: SobolIndex(*row) for name, row in zip(names, rows, strict=True)}


def _problem(inputs: int) -> dict[str, Any]:
    names = [str(k) for k in range(inputs)]
    return {"num_vars": inputs, "names": names, "bounds": [[0.0, 1.0]] * inputs}
