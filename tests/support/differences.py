"""Partial derivatives of symbolic equations by differences in 40 digits: the oracle of slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mpmath
import numpy as np


def partial_derivatives(
    function: Callable[..., Sequence], at: Sequence[float], nominal: Sequence[float]
) -> np.ndarray:
    """Of a function by SymPy for mpmath, shape (its values, its arguments).

    A difference over 1e-16 of a nominal value has a round-off of 1e-24 of a row's terms.
    """
    columns = []
    with mpmath.workdps(40):
        for j, size in enumerate(nominal):
            h = mpmath.mpf(size) * mpmath.mpf(10) ** -16
            up = [mpmath.mpf(v) for v in at]
            down = list(up)
            up[j], down[j] = up[j] + h, down[j] - h
            pairs = zip(function(*up), function(*down), strict=True)
            columns.append([float(mpmath.re(a - b) / (2 * h)) for a, b in pairs])
    return np.array(columns).T
