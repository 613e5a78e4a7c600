"""The balance of forces and voltages of a drive, averaged over short windows.

Newton's law is multiplied by a bell-shaped weight and integrated. The acceleration becomes the
second difference of averaged positions, so measured signals are not differentiated. Effects of a
recorder, an encoder or an amplifier within a sampling interval are averaged out. Forces and
commands are means over the interval after each sample.

The bell is a triangle of `width` samples on each side, convolved with the same triangle over the
samples: nearly the cubic B-spline of that spacing. The triangle alone would give the second
difference of three single readings; the convolution averages their noise.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dgtsv

from ...solver.arrays import Matrix, Vector


def windows(samples: int, width: int) -> int:
    """Number of bells of spacing `width` in a record of `samples` samples."""
    return max((samples - 1) // width - 3, 0)


def centres(samples: int, width: int) -> npt.NDArray[np.int64]:
    """Samples in the middle of the bells, shape (windows,)."""
    return (np.arange(windows(samples, width)) + 2) * width


@cache
def _hat(width: int) -> Vector:
    """Triangle over samples for the convolution, shape (2*width - 1,)."""
    return (width - np.abs(np.arange(1 - width, width))) / width**2


@cache
def _bell(width: int) -> Matrix:
    """The bell over intervals, by quarters, shape (4, width)."""
    rising = (np.arange(width) + 0.5) / width**2
    bell = np.convolve(np.concatenate([rising, rising[::-1]]), _hat(width))
    return np.concatenate([[0.0], bell, [0.0]]).reshape(4, width)


def averaged(values: Matrix, width: int) -> Matrix:
    """Averages of interval values, shape (n, ...), under each bell, shape (windows, ...).

    `width` is the spacing of the bells, and quarter of the length of one, in intervals.
    """
    count = windows(len(values), width)
    blocks = count + 3
    parts, bell = values[: blocks * width].reshape(blocks, width, -1), _bell(width)
    if parts.shape[2] == 1:  # one product of matrices instead of one per block
        quarters = (parts[:, :, 0] @ bell.T)[:, :, None]
    else:
        quarters = np.matmul(bell, parts)
    out = sum(quarters[q : q + count, q] for q in range(4))
    return np.asarray(out).reshape(count, *values.shape[1:])


def acceleration(x: Vector, step: float, width: int) -> Vector:
    """Average acceleration under each bell, from positions [m], shape (windows,) [m/s^2]."""
    smeared = np.convolve(x - x[0], _hat(width), mode="same")
    at = centres(len(x), width)
    second = smeared[at + width] - 2.0 * smeared[at] + smeared[at - width]
    return np.asarray(second / (width * step) ** 2)


def at_samples(values: Vector, samples: int, width: int) -> Vector:
    """Values of the windows, shape (windows,), interpolated at the samples, shape (samples,)."""
    return np.interp(np.arange(samples), centres(samples, width), values)


def per_interval(values: Vector) -> Vector:
    """Change over the interval after each sample, the last one twice, shape (n,)."""
    change = np.diff(values)
    return np.append(change, change[-1])


def lagged(command: Matrix, time_constant: float, step: float) -> Matrix:
    """Mean over each interval of a first-order lag of a held command, shape (n, ...).

    It is exact for lags slower and faster than the sampling; the lag starts in steady state.
    """
    if time_constant <= 0.0:
        return command
    kept = math.exp(-step / time_constant)
    state = carried_on(command[:1], (1.0 - kept) * command[:-1], kept)  # from steady state
    return np.asarray(command + _late_share(step, time_constant) * (state - command))


def carried_on(start: Matrix, more: Matrix, kept: float) -> Matrix:
    """States that are `kept` of the one before and some `more`, shape (1 + n, ...)."""
    given = np.concatenate([start, more])
    ones = np.ones(len(given))
    *_, states, _ = dgtsv(-kept * ones[1:], ones, 0.0 * ones[1:], given)
    return np.asarray(states.reshape(given.shape))


def between_samples(
    current: Vector, jumps: Vector, step: float, electrical: float, mechanical: float
) -> Vector:
    """Mean over each interval of a current known at the samples, shape (n,).

    If the winding responds within the interval, the current jumps with the voltage and then
    approaches its next sample with the speed. If the winding is slower, the current is linear
    between samples. `jumps` of the voltage at the samples, after the current is read, are divided
    by the resistance [A]. The times are the constants of the winding and of the speed [s].
    """
    after = np.append(current[1:], current[-1])
    straight = _start_share(step, electrical)
    answered = (1.0 - 2.0 * straight) ** 2
    share = answered * _start_share(step, mechanical) + (1.0 - answered) * straight
    return np.asarray(after + share * (current + answered * jumps - after))


def _start_share(step: float, time_constant: float) -> float:
    """Weight of the start in the mean of an exponential from start to end of an interval."""
    kept = math.exp(-step / time_constant) if time_constant > 0.0 else 0.0
    return (_late_share(step, time_constant) - kept) / (1.0 - kept)


def _late_share(step: float, time_constant: float) -> float:
    """Mean of exp(-t/time_constant) over an interval."""
    if time_constant <= 0.0:
        return 0.0
    return -math.expm1(-step / time_constant) * time_constant / step
