"""One identified parameter: its value, its interval, and why it is not identified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

Vector = npt.NDArray[np.float64]

CONFIDENCE = 0.95
NARROW = 0.3  # a parameter is identified if its interval is within this share of its value


@dataclass(frozen=True)
class Interval:
    """Value, standard error and 95 % confidence interval of one parameter.

    Attributes
    ----------
    standard_error : float or None
        None if the data give none.
    low, high : float or None
        None if the data give no bound.
    method : str
    identified : bool
        Whether both ends of the interval are within the share `NARROW` of the value.
    because, would_do : str
        Why it is not identified and which trial would be enough; empty if it is identified.
    """

    value: float
    unit: str
    standard_error: float | None
    low: float | None
    high: float | None
    method: str
    identified: bool
    because: str = ""
    would_do: str = ""

    def times(self, factor: float) -> Interval:
        """The interval in another unit: all numbers times a positive factor."""
        low, high = (None if b is None else b * factor for b in (self.low, self.high))
        return replace(self, value=self.value * factor, low=low, high=high)

    def plus(self, shift: float) -> Interval:
        """The interval with a number added to value and bounds."""
        low, high = (None if b is None else b + shift for b in (self.low, self.high))
        return replace(self, value=self.value + shift, low=low, high=high)


@dataclass(frozen=True)
class Spread:
    """Mean and two-standard-deviation band of values identified from single trials (Ref. [57]).

    Attributes
    ----------
    deviation : float
        Sample standard deviation, n - 1 in its denominator.
    low, high : float
        Mean less and plus two standard deviations.
    outside : tuple of int
        Positions of the values beyond the band.
    """

    mean: float
    deviation: float
    low: float
    high: float
    outside: tuple[int, ...]


def spread(values: Sequence[float] | Vector) -> Spread:
    """Mean, standard deviation and two-standard-deviation band of trial results.

    Raises
    ------
    ValueError
        If there are fewer than two values.
    """
    array = np.asarray(values, dtype=float)
    if len(array) < 2:
        raise ValueError(f"a spread of {len(array)} values given; expected at least two")
    mean, deviation = float(array.mean()), float(array.std(ddof=1))
    low, high = mean - 2 * deviation, mean + 2 * deviation
    outside = tuple(int(k) for k in np.flatnonzero((array < low) | (array > high)))
    return Spread(mean, deviation, low, high, outside)


def is_narrow(value: float, low: float | None, high: float | None) -> bool:
    """Whether an interval is narrow enough for its value to be identified."""
    if low is None or high is None:
        return False
    return max(high - value, value - low) <= NARROW * abs(value)


def student_interval(
    value: float, error: float, freedom: int, unit: str, method: str, because: str = ""
) -> Interval:
    """A symmetric interval from a standard error with few degrees of freedom."""
    if freedom < 1 or not math.isfinite(error):
        return Interval(value, unit, None, None, None, method, False, because)
    reach = float(student.ppf(0.5 + CONFIDENCE / 2, freedom)) * error
    low, high = value - reach, value + reach
    narrow = is_narrow(value, low, high)
    return Interval(value, unit, error, low, high, method, narrow, "" if narrow else because)


def average(first: Interval, second: Interval) -> Interval:
    """The mean of both directions' values, as used in the thesis for its nominal parameters."""
    value = 0.5 * (first.value + second.value)
    method = "mean of both directions"
    because = "; ".join(
        f"{side}: {i.because}"
        for side, i in (("forwards", first), ("backwards", second))
        if i.because
    )
    if first.low is None or first.high is None or second.low is None or second.high is None:
        return Interval(value, first.unit, None, None, None, method, False, because)
    down = 0.5 * math.hypot(first.value - first.low, second.value - second.low)
    up = 0.5 * math.hypot(first.high - first.value, second.high - second.value)
    error = None
    if first.standard_error is not None and second.standard_error is not None:
        error = 0.5 * math.hypot(first.standard_error, second.standard_error)
    low, high = value - down, value + up
    narrow = is_narrow(value, low, high)
    return Interval(value, first.unit, error, low, high, method, narrow, "" if narrow else because)
