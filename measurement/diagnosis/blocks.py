"""Mean squares of signals, and their 95 % intervals by resampling blocks of the signals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ...solver.arrays import Mask, Vector
from .modelled_record import ModelledRecord

_DRAWS = 2000
_FEWEST = 4  # blocks needed for an interval
_AHEAD = 1.0  # time over which a position is predicted from a known state [s]
_NORMAL = 1.96  # quantile of the normal distribution


@dataclass(frozen=True)
class Estimate:
    """A value and its 95 % interval; None if there are too few blocks for an interval."""

    value: float
    interval: tuple[float, float] | None


class Blocks:
    """Signals cut into blocks.

    Neighbouring blocks are drawn together, as many as the cube root of the number of blocks,
    because an effect longer than a block is no new evidence. A few blocks scatter less than the
    population, so the interval is widened as in Student's distribution.

    Parameters
    ----------
    ends : sequence of int
        Ends of the blocks among n samples: 0, ..., n.
    """

    def __init__(self, ends: Sequence[int]) -> None:
        self._starts = np.array(ends[:-1])
        self._blocks = len(self._starts)
        together = max(round(self._blocks ** (1 / 3)), 1)
        draws = (_DRAWS, -(-self._blocks // together))
        first = np.random.default_rng(0).integers(0, self._blocks, draws)
        drawn = (first[:, :, None] + np.arange(together)) % self._blocks
        self._drawn = drawn.reshape(_DRAWS, -1)
        independent = self._blocks / together
        free = max(independent - 1.0, 1.0)
        self._wider = float(student.ppf(0.975, free)) / _NORMAL * math.sqrt(independent / free)

    def rms(self, values: Vector, counted: Mask | None = None) -> Estimate:
        """Root mean square of values, shape (n,), over the counted samples."""
        mask = np.ones(len(values), dtype=bool) if counted is None else counted
        found = self._ratio(values**2 * mask, mask.astype(float))
        ends = found.interval and (math.sqrt(found.interval[0]), math.sqrt(found.interval[1]))
        return Estimate(math.sqrt(found.value), ends)

    def gain(self, before: Vector, after: Vector, counted: Mask | None = None) -> Estimate:
        """Share by which the mean square falls from `before` to `after`, shape (n,)."""
        mask = np.ones(len(before), dtype=bool) if counted is None else counted
        left = self._ratio(after**2 * mask, before**2 * mask)
        ends = left.interval and (1.0 - left.interval[1], 1.0 - left.interval[0])
        return Estimate(1.0 - left.value, ends)

    def _ratio(self, above: Vector, below: Vector) -> Estimate:
        """Ratio of the sums of two arrays of non-negative values, each shape (n,)."""
        tops, bottoms = (np.add.reduceat(values, self._starts) for values in (above, below))
        top, bottom = float(tops.sum()), float(bottoms.sum())
        if top == 0.0 or bottom == 0.0:
            return Estimate(0.0 if bottom else 1.0, None)
        if min(np.count_nonzero(tops), np.count_nonzero(bottoms)) < _FEWEST:
            return Estimate(top / bottom, None)
        up, down = (sums[self._drawn].sum(axis=1) for sums in (tops, bottoms))
        kept = (up > 0.0) & (down > 0.0)
        middle = math.log(top / bottom)
        quantiles = np.quantile(np.log(up[kept] / down[kept]), [0.025, 0.975])
        low, high = middle + self._wider * (quantiles - middle)
        return Estimate(top / bottom, (math.exp(low), math.exp(high)))


def ends_of_seconds(courses: Sequence[ModelledRecord], least: int = 1) -> list[int]:
    """Ends of the seconds over which positions are predicted, among all samples.

    If a record is too short for the `least` number of blocks, its blocks are shorter.
    """
    ends = [0]
    for c in courses:
        start, n = ends[-1], len(c.x)
        every = max(2, min(round(_AHEAD / c.step), n // least))
        ends += [start + k for k in (*range(every, n, every), n)]
    return ends
