"""Bliman-Sorine's parameters from two points of a hysteresis loop: Eqs. 2.8-2.11 of the thesis.

The map has a solution only under condition 2.11; "no solution", with the reason, is an answer.
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
    """Break-away (x_e, Fs) and the approach to sliding (x_p, Fc), magnitudes [m], [N]."""

    fs: float
    fc: float
    x_e: float
    x_p: float


@dataclass(frozen=True)
class BlimanSorine:
    """Parameters of Eq. 1.4 with the p of Eq. 2.10 they come from; [N], [N], [m]."""

    f1: float
    f2: float
    eps_f: float
    eta: float
    p: float


def map_points(points: ReferencePoints) -> BlimanSorine:
    """Eqs. 2.8-2.10.

    Parameters
    ----------
    points : ReferencePoints

    Raises
    ------
    NoSolution
        If condition 2.11 does not hold, or there is no peak at all.
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
        # Eq. 2.10 over p - 1, which leaves the root p > 1 alone
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
    """The points after a reversal that belong to given parameters, the inverse of `map_points`."""
    fc = f1 - f2
    p = f1 / (eta * f2)
    product = 2 * (1 / eta - 1) / (p - 1 / eta)
    x_p = 3 * eps_f
    log_m2 = (product + 2) / product * math.log(p) / (p - 1)
    fs = fc * (1 + product * math.exp(-log_m2))
    return ReferencePoints(fs, fc, log_m2 * x_p / 3, x_p)


def read_points(x: Vector, friction: Vector) -> ReferencePoints:
    """The two points of one branch of a hysteresis loop, from the reversal on.

    Fc is the median over the last half of the way; x_p is the first place after the peak where
    friction is within 5 % of Fc^2 of it, as Fig. 1.7 defines it.

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
