"""Sobol indices of a figure, by SALib, on runs that are made for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .comparison import LEVEL
from .reading import BadPlan

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

RESAMPLES = 200  # of the bootstrap of the intervals


@dataclass(frozen=True)
class SobolIndex:
    """Share of the variance of a figure's logarithm that comes from one variation.

    Attributes
    ----------
    first, total : float
        Alone; and with all its interactions with others.
    first_within, total_within : float
        Half the width of their 90 % intervals, by a bootstrap over the sample.
    """

    first: float
    first_within: float
    total: float
    total_within: float


def sobol_shares(count: int, inputs: int, seed: int) -> Matrix:
    """Points of the unit cube, shape (count (inputs + 2), inputs), in SALib's order.

    A scrambled sequence after Sobol in the scheme of A. Saltelli et al., Computer Physics
    Communications 181, 259 (2010).

    Raises
    ------
    BadPlan
        If SALib is not installed.
    """
    try:
        from SALib.sample import sobol
    except ImportError:
        raise BadPlan("sensitivity: sobol needs SALib: pip install 'ballscrew[sobol]'") from None
    points = sobol.sample(_problem(inputs), count, calc_second_order=False, seed=seed)
    return np.asarray(points, dtype=np.float64)


def sobol_indices(figure: Vector, names: list[str], seed: int) -> dict[str, SobolIndex]:
    """Indices of the logarithm of a positive figure at the points of `sobol_shares`.

    Returns
    -------
    dict of str to SobolIndex
        By name; empty if a run has no such figure, all zero if it does not change.
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
