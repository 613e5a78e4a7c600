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
FARTHEST = 300.0  # nats of one exponential; the square of what it leaves is a number still
TOO_WIDE = 25.0  # nats at which it has lost digits that count, and is done again
# A tangent is slow where a step changes it by less than a share of SLOW * MOST_PARTS of its length:
# collocation in as many parts of the step is better for it than piecewise constant Jacobians.
SLOW = 0.3
MOST_PARTS = 4
COLLAPSED = 1e-13  # share of a tangent's length below which its direction of its own is gone


_ROOT = math.sqrt(6.0)
RADAU = (
    ((88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225),
    ((296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225),
    ((16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9),
)
RADAU_NODES = ((4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0)


@njit(cache=True, error_model="numpy")
def collocate(jacobians: Any, h: float, frame: Any, count: int, n: int, scratch: Any) -> None:
    """Let the linear equation act on the first `count` tangents over a step, in place.

    Radau IIA of three stages (e.g. E. Hairer and G. Wanner, Solving Ordinary Differential
    Equations II, Springer 1996, Section IV.5), as one linear system.

    Parameters
    ----------
    jacobians : ndarray, shape (3, n, n)
        At `RADAU_NODES` of the step.
    scratch : ndarray, shape (9 n n + 6 n,) at least
    """
    size = 3 * n
    matrix = scratch[: size * size].reshape((size, size))
    stages = scratch[size * size : size * size + size]
    pivots = scratch[size * size + size : size * size + 2 * size]
    for a in range(3):
        for b in range(3):
            weight = h * RADAU[a][b]
            for i in range(n):
                for j in range(n):
                    matrix[a * n + i, b * n + j] = -weight * jacobians[b, i, j]
        for i in range(n):
            matrix[a * n + i, a * n + i] += 1.0
    factorize(matrix, pivots, size)
    for k in range(count):
        for a in range(3):
            for i in range(n):
                stages[a * n + i] = frame[k, i]
        solve_factorized(matrix, pivots, size, stages)
        for i in range(n):
            frame[k, i] = stages[2 * n + i]


@njit(cache=True, error_model="numpy")
def slow_ones(jacobian: Any, frame: Any, scale: Any, h: float, changes: Any) -> int:
    """How many of the first tangents are slow; their changes in a step of `h`, over their lengths.

    Parameters
    ----------
    changes : ndarray, shape (count,)
        Out.
    """
    count, n = frame.shape
    for k in range(count):
        length, change = 0.0, 0.0
        for i in range(n):
            rate = 0.0
            for j in range(n):
                rate += jacobian[i, j] * frame[k, j]
            change += (h * rate / scale[i]) ** 2
            length += (frame[k, i] / scale[i]) ** 2
        changes[k] = math.sqrt(change / length)
        if not changes[k] <= SLOW * MOST_PARTS:
            return k
    return int(count)


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
def free_of_others(frame: Any, j: int) -> float:
    """Take the directions of the rows before it from row `j`; the square of what is left of it."""
    n = frame.shape[1]
    for k in range(j):
        dot = 0.0
        for i in range(n):
            dot += frame[k, i] * frame[j, i]
        for i in range(n):
            frame[j, i] -= dot * frame[k, i]
    square = 0.0
    for i in range(n):
        square += frame[j, i] ** 2
    return square


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
        square = free_of_others(frame, j)
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
                free_of_others(frame, j)
                square = free_of_others(frame, j)  # the second time for round-off
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
    whole = norm
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
        spread = whole
    for j in range(count):
        saved_logs[j] = logs[j]
        for i in range(n):
            saved[j, i] = frame[j, i]
    for _ in range(60):
        exponential(omega, e, n, rest)
        parts = halvings
        while parts > 0 and max(spread, whole * SPREAD / FARTHEST) * 0.5 ** (parts - 1) <= SPREAD:
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
