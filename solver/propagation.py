"""Tangent vectors pushed by a matrix exponential and orthonormalized, whatever the system.

Compiled once for all systems, unlike what is in `tangents`.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from .stepper import factorize, solve_factorized

PADE = (1.0, 1 / 2, 5 / 44, 1 / 66, 1 / 792, 1 / 15840, 1 / 665280)  # of exp, six over six
SMALL = 0.5  # norm up to which they are right to the last digit
SPREAD = 16.0  # nats between first and last tangent that one orthonormalization may meet
TOO_WIDE = 25.0  # nats at which it has lost digits that count, and is done again
COLLAPSED = 1e-13  # share of a tangent's length below which its direction of its own is gone


@njit(cache=True, error_model="numpy")
def multiply(a: Any, b: Any, c: Any, n: int) -> None:
    """Write the product of the n x n matrices `a` and `b` to `c`."""
    for i in range(n):
        for j in range(n):
            c[i, j] = 0.0
        for k in range(n):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(n):
                    c[i, j] += factor * b[k, j]


@njit(cache=True, error_model="numpy")
def exponential(a: Any, e: Any, n: int, scratch: Any) -> None:
    """Write exp(a) to `e` for a matrix of norm at most `SMALL`; `a` stays."""
    power = scratch[: n * n].reshape((n, n))
    other = scratch[n * n : 2 * n * n].reshape((n, n))
    below = scratch[2 * n * n : 3 * n * n].reshape((n, n))
    column = scratch[3 * n * n : 3 * n * n + n]
    pivots = scratch[3 * n * n + n : 3 * n * n + 2 * n]
    for i in range(n):
        for j in range(n):
            unit = 1.0 if i == j else 0.0
            power[i, j] = a[i, j]
            e[i, j] = unit + PADE[1] * a[i, j]
            below[i, j] = unit - PADE[1] * a[i, j]
    sign = 1.0
    for k in range(2, 7):
        multiply(power, a, other, n)
        for i in range(n):
            for j in range(n):
                power[i, j] = other[i, j]
                e[i, j] += PADE[k] * other[i, j]
                below[i, j] += sign * PADE[k] * other[i, j]
        sign = -sign
    factorize(below, pivots, n)
    for j in range(n):
        for i in range(n):
            column[i] = e[i, j]
        solve_factorized(below, pivots, n, column)
        for i in range(n):
            e[i, j] = column[i]


@njit(cache=True, error_model="numpy")
def orthonormalize(frame: Any, logs: Any) -> float:
    """Orthonormalize the rows of `frame` in order and add the logarithms of what is left of them.

    A row that had no direction of its own left gets some other one, and minus infinity.

    Returns
    -------
    float
        Difference between the largest and the smallest of the logarithms [nats]; collapsed rows
        do not count.
    """
    count, n = frame.shape
    low, high = math.inf, -math.inf
    for j in range(count):
        before = 0.0
        for i in range(n):
            before += frame[j, i] ** 2
        for k in range(j):
            dot = 0.0
            for i in range(n):
                dot += frame[k, i] * frame[j, i]
            for i in range(n):
                frame[j, i] -= dot * frame[k, i]
        square = 0.0
        for i in range(n):
            square += frame[j, i] ** 2
        if square > COLLAPSED * COLLAPSED * before:
            length = math.sqrt(square)
            growth = math.log(length)
            logs[j] += growth
            low, high = min(low, growth), max(high, growth)
        else:
            logs[j] = -math.inf
            length = 0.0
            for axis in range(n):  # some direction that the rows before leave free
                for i in range(n):
                    frame[j, i] = 1.0 if i == axis else 0.0
                for _ in range(2):
                    for k in range(j):
                        dot = 0.0
                        for i in range(n):
                            dot += frame[k, i] * frame[j, i]
                        for i in range(n):
                            frame[j, i] -= dot * frame[k, i]
                square = 0.0
                for i in range(n):
                    square += frame[j, i] ** 2
                if square > 0.5 / n:
                    length = math.sqrt(square)
                    break
        for i in range(n):
            frame[j, i] /= length
    return high - low if high >= low else 0.0


@njit(cache=True, error_model="numpy")
def apply(matrix: Any, frame: Any, row: Any) -> None:
    """Multiply every row of `frame`, as a column, by `matrix`, in place."""
    count, n = frame.shape
    for j in range(count):
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += matrix[i, k] * frame[j, k]
            row[i] = total
        for i in range(n):
            frame[j, i] = row[i]


@njit(cache=True, error_model="numpy")
def push(
    omega: Any, frame: Any, logs: Any, scale: Any, spread: float, n: int, scratch: Any
) -> float:
    """Let exp(omega) act on the tangents, orthonormalizing as often as their spread asks for.

    Parameters
    ----------
    omega : ndarray, shape (n, n)
        Overwritten.
    frame : ndarray, shape (count, n)
        Orthonormal tangents, a row each.
    logs : ndarray, shape (count,)
        Their logarithms so far.
    scale : ndarray, shape (n,)
        Powers of two near the states' magnitudes.
    spread : float
        Nats that are expected between first and last; not positive where nothing is known.

    Returns
    -------
    float
        The nats that were found.
    """
    count = frame.shape[0]
    e = scratch[: n * n].reshape((n, n))
    rest = scratch[n * n :]
    saved = rest[: n * n].reshape((n, n))
    saved_logs = rest[n * n : n * n + n]
    row = rest[n * n + n : n * n + 2 * n]
    rest = rest[n * n + 2 * n :]
    # In units near the states' own, the norm is of the size of the fastest rate.
    norm = 0.0
    for j in range(n):
        total = 0.0
        for i in range(n):
            omega[i, j] *= scale[j] / scale[i]
            total += abs(omega[i, j])
        norm = max(norm, total)
    if not norm < math.inf:
        for j in range(count):
            logs[j] = math.nan
        return 0.0
    halvings = 0
    while norm > SMALL:
        norm *= 0.5
        halvings += 1
    factor = 0.5**halvings
    for i in range(n):
        for j in range(n):
            omega[i, j] *= factor
    if count == 1:
        spread = 0.0  # nothing to be orthogonal to
    elif not spread > 0.0:
        spread = norm / factor
    for j in range(count):
        saved_logs[j] = logs[j]
        for i in range(n):
            saved[j, i] = frame[j, i]
    for _ in range(60):
        exponential(omega, e, n, rest)
        parts = halvings
        while parts > 0 and spread * 0.5 ** (parts - 1) <= SPREAD:
            multiply(e, e, rest[: n * n].reshape((n, n)), n)
            for i in range(n):
                for j in range(n):
                    e[i, j] = rest[i * n + j]
            parts -= 1
        for i in range(n):
            for j in range(n):
                e[i, j] *= scale[i] / scale[j]
        found, widest = 0.0, 0.0
        for _ in range(2**parts):
            apply(e, frame, row)
            met = orthonormalize(frame, logs)
            widest = max(widest, met)
            found += met
        if widest <= TOO_WIDE or parts == halvings:
            return found
        spread = 2.0 * max(spread, widest * 2.0**parts)
        for j in range(count):
            logs[j] = saved_logs[j]
            for i in range(n):
                frame[j, i] = saved[j, i]
    return found
