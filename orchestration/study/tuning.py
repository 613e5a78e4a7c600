"""A controller of a study in its loop, and its tuning, which is the same for every controller.

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

from ...solver.errors import UserError
from ...solver.kernel import CONTROLLER, PLANT
from ...solver.signals import Parameter
from ..loop.catalogue import LIMIT, OWN_LIMIT
from ..loop.machine import limit_of
from .figures import Figures, measured
from .loop import AnyLoop, Course
from .plan import Duty, Entrant, Plan

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
    for place, tell in _candidates(start, names, scales, 2 * budget - 1, seed):
        if tried == budget:
            at_budget = best, found
        values = {n: s.value(c) for n, s, c in zip(names, scales, place, strict=True)}
        price = cost({**published, **values})
        tell(price)
        tried += 1
        if price < best:
            best, found = price, values
    kept_cost, kept = at_budget or (best, found)
    places = {n: s.place(kept[n]) for n, s in zip(names, scales, strict=True)}
    ends = tuple(n for n, at in places.items() if not 0.01 <= at <= 0.99)
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


def _candidates(
    start: Mapping[str, float],
    names: list[str],
    scales: list[_Scale],
    count: int,
    seed: int | Sequence[int],
) -> Iterator[tuple[Vector, Callable[[float], None]]]:
    """Yield candidates, and what takes the cost of each before the next generation."""
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
            yield point[: len(names)], prices.append
        left -= len(prices)
        if len(prices) == len(generation):
            search.tell(generation, prices)


SEED = "_seed"  # end of the name of a noise's seed
BETWEEN_SOURCES = 1_000_000  # difference of the seeds of two noises


@dataclass(frozen=True)
class Contender:
    """A controller that takes part in a study, in its loop."""

    plan: Plan
    entrant: Entrant
    loop: AnyLoop

    def values(
        self, gains: Mapping[str, float], duty: Duty, drawn: Sequence[float], number: int
    ) -> dict[str, float]:
        """Parameters of a run, by the loop's names, that differ from their defaults.

        Noise sources get seeds that follow from the number of the drawn plant: the same for all
        controllers and duties on it, different ones on other plants, and a different one for each
        source. Factors of `drawn`, one for each variation, are on the nominal value, or on that of
        the duty.
        """
        known = {p.name: p.default for p in self.loop.parameters}
        limit = limit_of(self._known(PLANT), {}, self.plan.command_limit)
        values = {n: limit for n in (PLANT + LIMIT, CONTROLLER + OWN_LIMIT) if n in known}
        values |= {PLANT + n: v for n, v in duty.plant.items()}
        for variation, draw in zip(self.plan.variations, drawn, strict=True):
            for name, factor in variation.factors(draw).items():
                values[PLANT + name] = values.get(PLANT + name, known[PLANT + name]) * factor
        values |= {CONTROLLER + n: v for n, v in {**self.entrant.values, **gains}.items()}
        sources = sorted(n for n in known if n.endswith(SEED))
        return values | {n: float(1 + number + k * BETWEEN_SOURCES) for k, n in enumerate(sources)}

    def run(
        self, gains: Mapping[str, float], duty: Duty, drawn: Sequence[float], number: int
    ) -> tuple[Course, Figures]:
        """A run and its figures; see `values`."""
        values = self.values(gains, duty, drawn, number)
        motion = duty.signal(), duty.stop
        return measured(self.loop, values, motion, self.plan.tolerance, self.plan.count)

    def tuned(self, seed: int) -> Tuned:
        """Tune on the duties for tuning, on the nominal plant and on those drawn for it."""
        plan, entrant = self.plan, self.entrant
        draws = plan.draws("tune")

        def cost(gains: Mapping[str, float]) -> float:
            prices = []
            for duty in plan.tuning_duties:
                size = float(np.abs(duty.signal().values).max())
                for number, drawn in enumerate(draws):
                    _, found = self.run(gains, duty, drawn, number)
                    prices.append(price(found, size, plan.tuning.limits))
            return sum(prices) / len(prices)

        known = self._known(CONTROLLER)
        published = {n: entrant.values.get(n, known[n].default) for n in entrant.tune}
        for name, value in published.items():  # an FMU may give no start
            published[name] = value if math.isfinite(value) else sum(entrant.tune[name]) / 2
        number = [e.name for e in plan.entrants].index(entrant.name)
        random = [plan.seed, number, seed]
        return tune(cost, published, entrant.tune, plan.tuning.budget, random)

    def check(self) -> None:
        """Check that what is set or tuned exists and is in its range; raises `UserError`."""
        where = f"controllers.{self.entrant.name}"
        asked = [(n, (value,)) for n, value in self.entrant.values.items()]
        for name, ends in [*asked, *self.entrant.tune.items()]:
            self._check(where, CONTROLLER, name, *ends)

    def check_plants(self) -> None:
        """Make sure that all plants are possible: of each duty, as drawn, at the ends of ranges.

        Raises `UserError`.
        """
        plan = self.plan
        if plan.command_limit is not None and LIMIT not in self._known(PLANT):
            raise UserError(
                f"command_limit is {plan.command_limit:g}, and {plan.plant} has no parameter "
                f"{LIMIT} for it; remove command_limit, or wrap the plant with "
                "plant.direct_drive.with_command_limit"
            )
        varied = [name for variation in plan.variations for name in variation.parameters]
        for name in varied:
            self._check("vary", PLANT, name)
        for duty in plan.duties:
            for name, value in duty.plant.items():
                self._check(f"duty {duty.name}", PLANT, name, value)
            for row in plan.rows_to_check():
                values = self.values({}, duty, row, 0)
                for name in varied:
                    self._check("vary", PLANT, name, values[PLANT + name])

    def _known(self, side: str) -> dict[str, Parameter]:
        """Parameters of one part, by its own names."""
        of_loop = self.loop.parameters
        return {p.name.removeprefix(side): p for p in of_loop if p.name.startswith(side)}

    def _check(self, where: str, side: str, name: str, *values: float) -> None:
        known = self._known(side)
        if name not in known:
            raise UserError(f"{where}: no parameter {name!r}; there are {', '.join(sorted(known))}")
        low, high = known[name].minimum, known[name].maximum
        for value in values:
            if not low <= value <= high:
                within = f"[{low:g}, {high:g}]"
                raise UserError(f"{where}: {name} would be {value:g}, expected within {within}")
