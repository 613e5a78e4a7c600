"""Dahl's sigma and Fc from one trial each, Eqs. 2.5-2.7 of the thesis.

Eq. 2.5 is printed as -Fc exp(+sigma x/Fc) + Fc; from Eq. 1.2 with F(0) = 0 the exponent of forward
motion is -sigma x/Fc, as used here. For backward motion, x < 0, Eq. 2.6 is right.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.optimize import curve_fit

from .intervals import Interval, student_interval

Vector = npt.NDArray[np.float64]
_METHOD = "least squares on Eqs. 2.5-2.7; residuals taken as independent"


def dahl_curve(x: Vector, sigma: float, fc: float) -> Vector:
    """Friction [N] over the displacement from rest [m], one direction; alpha = 1."""
    return np.asarray(np.sign(x) * fc * -np.expm1(-sigma * np.abs(x) / fc))


def fit_dahl(x: Vector, friction: Vector) -> dict[str, Interval]:
    """sigma and Fc of one trial in one direction.

    Parameters
    ----------
    x, friction : ndarray, shape (n,)
        Displacement from rest [m] and friction [N].

    Raises
    ------
    ValueError
        If there are fewer than three samples or no motion.
    """
    if len(x) < 3 or not np.ptp(x) > 0:
        raise ValueError(
            f"{len(x)} samples over {np.ptp(x) if len(x) else 0:.3g} m do not fit a curve"
        )
    level = max(float(np.median(np.abs(friction[np.abs(x) > 0.3 * np.abs(x).max()]))), 1e-6)
    rising = (np.abs(friction) > 0.2 * level) & (np.abs(friction) < 0.7 * level)
    ways = np.abs(x[rising & (np.abs(x) > 0)])
    slope = 0.5 * level / float(np.median(ways)) if len(ways) else level / 2e-5
    found, covariance = curve_fit(
        dahl_curve,
        x,
        friction,
        p0=(slope, level),
        bounds=([1e-3, 1e-9], [np.inf, np.inf]),
        x_scale=(slope, level),
    )
    early = int(np.count_nonzero(np.abs(x) < 2 * found[1] / found[0]))
    because = {
        "sigma": f"only {early} samples lie on the rise of the friction",
        "Fc": "the motion ends before the friction becomes constant",
    }
    return {
        name: student_interval(
            float(found[k]), math.sqrt(covariance[k, k]), len(x) - 2, unit, _METHOD, because[name]
        )
        for k, (name, unit) in enumerate((("sigma", "N/m"), ("Fc", "N")))
    }
