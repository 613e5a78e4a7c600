"""Tuning: the same optimizer, budget, duties, plants and limits for every controller.

The optimizer is CMA-ES, by its author's own package (N. Hansen, `cma`): maintained since 2008, made
for few, ill-scaled, coupled parameters and a budget of a hundred candidates; it uses only ranks, so
that no scaling of the figure favours a controller. Parameters with a positive range are tuned on
a logarithmic scale. The published rule is the first candidate: no tuning is worse than it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .figures import Figures

Vector = npt.NDArray[np.float64]
Cost = Callable[[Mapping[str, float]], float]

FAILED = 1e6  # price of a run that fails
OVER_LIMIT = 10.0  # price of each limit that is exceeded by its own size
SPREAD = 0.2  # of each range, of the first candidates


def price(found: Figures, size: float, limits: Mapping[str, float]) -> float:
    """Price of a run: its rms error over a size [m], and more for figures beyond their limits."""
    if found.failed:
        return FAILED
    paid = min(FAILED, found.rms_error / size)
    for name, most in limits.items():
        reached = getattr(found, name)
        if reached > most:
            excess = reached / most - 1 if most > 0 else reached
            paid += OVER_LIMIT * min(excess, FAILED)
    return paid


@dataclass(frozen=True)
class Tuned:
    """Values that a tuning found."""

    values: dict[str, float]  # the best within the budget
    cost: float
    published_cost: float  # cost of the published rule
    doubled_cost: float  # the best within twice the budget
    tried: int  # number of all candidates
    at_bound: tuple[str, ...] = ()  # values that ended within 1 % of an end of their range


def tune(
    cost: Cost,
    published: Mapping[str, float],
    ranges: Mapping[str, tuple[float, float]],
    budget: int,
    seed: int | Sequence[int],
) -> Tuned:
    """Find values with a small cost, from published ones on.

    Without any range the published values are the result. The same values always have the same
    cost, which is not NaN. `budget` candidates are for the result; as many again show what more
    candidates would gain.
    """
    names = list(ranges)
    start = {n: float(np.clip(published[n], *ranges[n])) for n in names}
    first = cost(published)
    if not names:
        return Tuned({}, first, first, first, 1)
    scales = [_Scale(*ranges[n]) for n in names]
    best, found, tried = first, {n: published[n] for n in names}, 1
    at_budget: tuple[float, dict[str, float]] | None = None
    for candidate in _candidates(start, names, scales, 2 * budget - 1, seed):
        if tried == budget:
            at_budget = best, found
        values = {n: s.value(c) for n, s, c in zip(names, scales, candidate.place, strict=True)}
        price = cost({**published, **values})
        candidate.tell(price)
        tried += 1
        if price < best:
            best, found = price, values
    kept_cost, kept = at_budget or (best, found)
    places = {n: s.place(kept[n]) for n, s in zip(names, scales, strict=True)}
    ends = tuple(n for n, place in places.items() if not 0.01 <= place <= 0.99)
    return Tuned(kept, kept_cost, first, best, tried, ends)


@dataclass(frozen=True)
class _Scale:
    """A range as the unit interval, logarithmic if it is positive."""

    low: float
    high: float

    def value(self, place: float) -> float:
        if self.low > 0:
            return float(self.low * (self.high / self.low) ** place)
        return float(self.low + (self.high - self.low) * place)

    def place(self, value: float) -> float:
        if self.low > 0:
            return math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class _Candidate:
    place: Vector
    tell: Callable[[float], None]


def _candidates(
    start: Mapping[str, float],
    names: list[str],
    scales: list[_Scale],
    count: int,
    seed: int | Sequence[int],
) -> Iterator[_Candidate]:
    """Yield one candidate after the other; each must get its cost before the next generation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about packages that it does not need
        import cma

        state = np.random.SeedSequence(seed).generate_state(1)[0]
        place = [s.place(start[n]) for n, s in zip(names, scales, strict=True)]
        place += [0.5] * (2 - len(place))  # it fails with one coordinate: add one that is not used
        options = {"bounds": [0, 1], "seed": int(state % (2**31 - 2)) + 1, "verbose": -9}
        search = cma.CMAEvolutionStrategy(place, SPREAD, options)
    left = count
    while left > 0:
        generation = search.ask()
        prices: list[float] = []
        for point in generation[:left]:
            yield _Candidate(point[: len(names)], prices.append)
        left -= len(prices)
        if len(prices) == len(generation):
            search.tell(generation, prices)
