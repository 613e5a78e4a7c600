"""Bliman-Sorine's parameters from two points of a hysteresis loop: Eqs. 2.8-2.11 of the thesis.

The map has a solution only under condition 2.11. Otherwise `NoSolution` gives the reason.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

Vector = npt.NDArray[np.float64]
_LARGEST_P = 1e12


class NoSolution(ValueError):
    """The two reference points fit no Bliman-Sorine law; the message says why."""


@dataclass(frozen=True)
class ReferencePoints:
    """Break-away (x_e, Fs) and start of sliding (x_p, Fc), as magnitudes [m], [N]."""

    fs: float
    fc: float
    x_e: float
    x_p: float


@dataclass(frozen=True)
class BlimanSorine:
    """Parameters of Eq. 1.4 [N], [N], [m], and the p of Eq. 2.10."""

    f1: float
    f2: float
    eps_f: float
    eta: float
    p: float


def map_points(points: ReferencePoints) -> BlimanSorine:
    """Parameters by Eqs. 2.8-2.10.

    Parameters
    ----------
    points : ReferencePoints

    Raises
    ------
    NoSolution
        If condition 2.11 does not hold, or the loop has no peak.
    """
    fs, fc, x_e, x_p = points.fs, points.fc, points.x_e, points.x_p
    if not (fc > 0 and x_e > 0 and x_p > 0):
        raise NoSolution(f"Fc = {fc:.4g} N, x_e = {x_e:.4g} m, x_p = {x_p:.4g} m: all must be > 0")
    if fs <= fc:
        raise NoSolution(f"no peak: Fs = {fs:.4g} N is not above Fc = {fc:.4g} N")
    log_m2 = 3 * x_e / x_p
    product = (fs - fc) / fc * math.exp(log_m2)
    ratio = (product + 2) / product
    if not log_m2 < ratio:
        raise NoSolution(
            f"condition 2.11 fails: ln m2 = 3 x_e/x_p = {log_m2:.4g}, but it must be below "
            f"(m1 m2 + 2)/(m1 m2) = {ratio:.4g}; the friction falls too sharply after break-away "
            f"(x_p = {x_p:.4g} m against x_e = {x_e:.4g} m)"
        )

    def gap(log_p: float) -> float:
        # Eq. 2.10 divided by p - 1, so that only the root p > 1 is left
        return ratio * log_p / math.expm1(log_p) - log_m2

    log_p = float(brentq(gap, 1e-12, math.log(_LARGEST_P), xtol=1e-15, rtol=1e-14))
    p = math.exp(log_p)
    return BlimanSorine(
        f1=(product + 2) * p / (2 * (p - 1)) * fc,
        f2=(product * p + 2) / (2 * (p - 1)) * fc,
        eps_f=x_p / 3,
        eta=(product + 2) / (product * p + 2),
        p=p,
    )


def points_of(f1: float, f2: float, eps_f: float, eta: float) -> ReferencePoints:
    """The points after a reversal for given parameters, the inverse of `map_points`."""
    fc = f1 - f2
    p = f1 / (eta * f2)
    product = 2 * (1 / eta - 1) / (p - 1 / eta)
    x_p = 3 * eps_f
    log_m2 = (product + 2) / product * math.log(p) / (p - 1)
    fs = fc * (1 + product * math.exp(-log_m2))
    return ReferencePoints(fs, fc, log_m2 * x_p / 3, x_p)


def read_points(x: Vector, friction: Vector) -> ReferencePoints:
    """The two points of one branch of a hysteresis loop, starting at the reversal.

    Fc is the median over the second half of the displacement. x_p is the first position after the
    peak at which friction differs from Fc by at most 5 % of Fc^2, as in Fig. 1.7.

    Parameters
    ----------
    x, friction : ndarray, shape (n,)
        Displacement since the reversal [m] and friction [N], both positive along the branch.

    Raises
    ------
    NoSolution
        If the branch has no peak or does not come back to Fc.
    """
    peak = int(np.argmax(friction))
    fc = float(np.median(friction[x > 0.5 * x.max()]))
    fs, x_e = float(friction[peak]), float(x[peak])
    near = np.flatnonzero(np.abs(friction[peak:] - fc) <= 0.05 * fc**2)
    if not len(near):
        raise NoSolution("after its peak the friction never comes within 5 % of its sliding value")
    return ReferencePoints(fs, fc, x_e, float(x[peak + near[0]]))
