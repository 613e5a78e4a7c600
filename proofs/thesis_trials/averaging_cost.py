"""Force error of one averaged set of friction parameters for both directions.

The thesis fits Eq. 1.8 to each direction and uses the means of the parameters in its nominal model
(Table 2.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ballscrew.identification.stribeck_fit import stribeck_curve
from thesis_trials.scatter import BadTable, number, read_columns

Vector = npt.NDArray[np.float64]

FASTEST = 5.5e-3  # largest speed of the trials in Table 2.4 [m/s]
_POINTS = 1101
FORWARDS, BACKWARDS = "positive_velocity", "negative_velocity"
_SYMBOLS = ("Fc", "Fs", "Vs", "sigma2")


@dataclass(frozen=True)
class ForceError:
    """Difference between two curves over a range of speed.

    Attributes
    ----------
    rms, largest : float
        Errors [N]; `largest` with its sign.
    at_speed : float
        Speed of the largest error [m/s].
    share : float
        `rms` over the root mean square of the force.
    """

    rms: float
    largest: float
    at_speed: float
    share: float


@dataclass(frozen=True)
class AveragingCost:
    """The error of an averaged friction curve in each direction.

    Attributes
    ----------
    fastest : float
        Upper end of the range of speed, which starts at rest [m/s].
    averaged : dict of str to float
        Means of both directions' Fc [N], Fs [N], Vs [m/s] and sigma2 [N*s/m].
    forwards, backwards : ForceError
        The curve of the averaged parameters less the curve of that direction.
    unavoidable : ForceError
        Half the difference of both directions, backwards less forwards: the smallest error of any
        single curve for both.
    of_parameters : ForceError
        The curve of the averaged parameters less the mean of both curves: the additional error by
        averaging parameters instead of forces.
    """

    fastest: float
    averaged: dict[str, float]
    forwards: ForceError
    backwards: ForceError
    unavoidable: ForceError
    of_parameters: ForceError


def averaging_cost(table: Path | str, fastest: float = FASTEST) -> AveragingCost:
    """Compare each direction's Stribeck curve with that of the averaged parameters.

    Parameters
    ----------
    table : Path or str
        CSV with the columns ``symbol``, ``positive_velocity`` and ``negative_velocity``, and rows
        for Fc, Fs, Vs and sigma2 in SI units.
    fastest : float
        Upper end of the range of speed [m/s].

    Returns
    -------
    AveragingCost

    Raises
    ------
    BadTable
        If the table does not have these columns and rows, or `fastest` is not above zero.
    """
    path = Path(table)
    if not (math.isfinite(fastest) and fastest > 0):
        raise BadTable(f"the fastest speed is {fastest:g} m/s, expected more than zero")
    columns = read_columns(path)
    for name in ("symbol", FORWARDS, BACKWARDS):
        if name not in columns:
            raise BadTable(f"{path}: no column {name!r}; there are {', '.join(columns)}")
    sides: dict[str, dict[str, float]] = {}
    for side in (FORWARDS, BACKWARDS):
        cells = dict(zip(columns["symbol"], columns[side], strict=True))
        missing = [s for s in _SYMBOLS if s not in cells]
        if missing:
            raise BadTable(f"{path}: no row for {', '.join(missing)}")
        sides[side] = {s: number(path, side, cells[s]) for s in _SYMBOLS}
        if not sides[side]["Vs"] > 0:
            raise BadTable(f"{path}: Vs is {sides[side]['Vs']:g} m/s, expected more than zero")
    averaged = {s: (sides[FORWARDS][s] + sides[BACKWARDS][s]) / 2 for s in _SYMBOLS}
    speeds = np.linspace(0.0, fastest, _POINTS)
    forwards, backwards = _curve(speeds, sides[FORWARDS]), _curve(speeds, sides[BACKWARDS])
    one, mean = _curve(speeds, averaged), (forwards + backwards) / 2
    return AveragingCost(
        fastest,
        averaged,
        _error(speeds, one - forwards, forwards),
        _error(speeds, one - backwards, backwards),
        _error(speeds, (backwards - forwards) / 2, mean),
        _error(speeds, one - mean, mean),
    )


def _curve(speeds: Vector, values: Mapping[str, float]) -> Vector:
    return stribeck_curve(speeds, values["Fc"], values["Fs"], values["Vs"], values["sigma2"])


def _error(speeds: Vector, error: Vector, force: Vector) -> ForceError:
    k = int(np.abs(error).argmax())
    rms = math.sqrt(float(np.mean(error**2)))
    size = math.sqrt(float(np.mean(force**2)))
    return ForceError(rms, float(error[k]), float(speeds[k]), rms / size)
