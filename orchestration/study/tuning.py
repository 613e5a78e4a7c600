"""A controller of a study in its loop, and its tuning, which is the same for every controller.

The optimizer is CMA-ES, by its author's own package (N. Hansen, `cma`): maintained since 2008, made
for few, ill-scaled, coupled parameters and a budget of a hundred candidates; it uses only ranks, so
that no scaling of the figure favours a controller. Parameters with a positive range are tuned on
a logarithmic scale. The published rule is the first candidate: no tuning is worse than it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from ...controllers import in_units_of
from ...plant.instruments import LIMIT, OWN_LIMIT, UNLIMITED, limit_of
from ...solver.errors import UserError
from ...solver.kernel import CONTROLLER, PLANT
from ...solver.signals import Parameter
from ..loop.catalogue import component
from ..loop.loop import Loop, of_side
from ..loop.parts import Part, check_names, check_range
from ..loop.whole_loop import loop_kernel
from ..master.reference_signal import Reference
from .plan import Duty, Entrant, Plan, Ranges
from .run import STEP, AnyLoop, Course, Figures, FmuLoop, StudyLoop, figures_of

if TYPE_CHECKING:
    from ...solver.component import Component

Gains = Mapping[str, float]
Drawn = Sequence[float]
Cost = Callable[[Gains], float]

FAILED = 1e6  # price of a run that fails
OVER_LIMIT = 10.0  # price of each limit that is exceeded by its own size
SPREAD = 0.2  # of each range, of the first candidates
SEED = "_seed"  # end of the name of a noise's seed
BETWEEN_SOURCES = 1_000_000  # difference of the seeds of two noises


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


def tune(cost: Cost, published: Gains, ranges: Ranges, budget: int, seed: int | list[int]) -> Tuned:
    """Find values with a small cost, from published ones on.

    Without any range the published values are the result. The same values always have the same
    cost, which is not NaN. `budget` candidates are for the result; as many again show what more
    candidates would gain.
    """
    tried = [(cost(published), {n: published[n] for n in ranges})]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about packages that it does not need
        import cma

        place = [_place(float(np.clip(published[n], *ends)), *ends) for n, ends in ranges.items()]
        place += [0.5] * (2 - len(place))  # it fails with one coordinate: add one that is not used
        state = np.random.SeedSequence(seed).generate_state(1)[0]
        options = {"bounds": [0, 1], "seed": int(state % (2**31 - 2)) + 1, "verbose": -9}
        search = cma.CMAEvolutionStrategy(place, SPREAD, options)
        while ranges and len(tried) < 2 * budget:
            points = search.ask()
            generation = []
            for point in points[: 2 * budget - len(tried)]:
                places = zip(ranges.items(), point, strict=False)
                values = {n: _value(at, *ends) for (n, ends), at in places}
                generation.append((cost({**published, **values}), values))
            if len(generation) == len(points):
                search.tell(points, [paid for paid, _ in generation])
            tried += generation
    (paid, found), (doubled, _) = (min(of, key=itemgetter(0)) for of in (tried[:budget], tried))
    ends_at = {n: _place(found[n], *ends) for n, ends in ranges.items()}
    at_bound = tuple(n for n, at in ends_at.items() if not 0.01 <= at <= 0.99)
    return Tuned(found, paid, tried[0][0], doubled, len(tried), at_bound)


def _value(place: float, low: float, high: float) -> float:
    """The value at a place of a range as the unit interval, logarithmic if it is positive."""
    return float(low * (high / low) ** place if low > 0 else low + (high - low) * place)


def _place(value: float, low: float, high: float) -> float:
    if low > 0:
        return math.log(max(value, 1e-300) / low) / math.log(high / low)
    return (value - low) / (high - low)


@dataclass(frozen=True)
class Contender:
    """A controller that takes part in a study, in its loop."""

    plan: Plan
    entrant: Entrant
    loop: AnyLoop

    @classmethod
    def of(cls, plan: Plan, entrant: Entrant) -> Contender:
        """A controller of a plan, whose loop can run; raises `UserError`."""
        loop: AnyLoop
        try:
            if Part(entrant.component).has_equations:
                kernel = loop_kernel(plan.plant, composed(plan, entrant))
                kernel.compile()
                loop = StudyLoop(kernel)
            elif plan.instruments or plan.delay:
                raise UserError("instruments and a delay are for equations, this is an FMU")
            else:
                loop = FmuLoop(Loop(entrant.component, plan.plant, sampled=plan.period or None))
                loop.run({}, (Reference.constant(0.0), 2.0 * (plan.period or STEP)))  # it can
            found = cls(plan, entrant, loop)
            known = found._known(CONTROLLER)
            check_names("the controller", (*entrant.values, *entrant.tune), known)
            ends = [(name, end) for name, ends in entrant.tune.items() for end in ends]
            for name, value in (*entrant.values.items(), *ends):
                check_range("the controller", name, value, known[name])
        except UserError as error:
            raise UserError(f"controllers.{entrant.name} on {plan.plant}: {error}") from error
        return found

    def values(self, gains: Gains, duty: Duty, drawn: Drawn, number: int) -> dict[str, float]:
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
                nominal = known.get(PLANT + name, math.nan)  # an unknown name is found later
                values[PLANT + name] = values.get(PLANT + name, nominal) * factor
        values |= {CONTROLLER + n: v for n, v in {**self.entrant.values, **gains}.items()}
        sources = sorted(n for n in known if n.endswith(SEED))
        return values | {n: float(1 + number + k * BETWEEN_SOURCES) for k, n in enumerate(sources)}

    def run(self, gains: Gains, duty: Duty, drawn: Drawn, number: int) -> tuple[Course, Figures]:
        """A run and its figures; see `values`."""
        values = self.values(gains, duty, drawn, number)
        course = self.loop.run(values, duty.motion, self.plan.tolerance)
        return course, figures_of(course, self.plan.count, values.get(PLANT + LIMIT, UNLIMITED))

    def cost(self, gains: Gains, sizes: Mapping[str, float]) -> float:
        """Mean price of the duties to tune on, on the nominal plant and on those drawn for it.

        `sizes` are the errors whose price is 1 [m], by duty.
        """
        plan = self.plan
        prices = [
            price(self.run(gains, duty, drawn, number)[1], sizes[duty.name], plan.tuning.limits)
            for duty in plan.tuning_duties
            for number, drawn in enumerate(plan.draws("tune"))
        ]
        return sum(prices) / len(prices)

    def tuned(self, seed: int) -> Tuned:
        """Tune it; an error as large as the motion has the price 1."""
        plan, entrant = self.plan, self.entrant
        known = self._known(CONTROLLER)
        published = {n: entrant.values.get(n, known[n].default) for n in entrant.tune}
        for name, value in published.items():  # an FMU may give no start
            published[name] = value if math.isfinite(value) else sum(entrant.tune[name]) / 2
        sizes = {d.name: float(np.abs(d.motion[0].values).max()) for d in plan.tuning_duties}
        number = [e.name for e in plan.entrants].index(entrant.name)
        cost = partial(self.cost, sizes=sizes)
        return tune(cost, published, entrant.tune, plan.tuning.budget, [plan.seed, number, seed])

    def check_plants(self) -> None:
        """Make sure that all plants are possible, of each duty, as drawn; raises `UserError`."""
        plan = self.plan
        if plan.command_limit is not None and LIMIT not in self._known(PLANT):
            raise UserError(
                f"command_limit is {plan.command_limit:g}, and {plan.plant} has no parameter "
                f"{LIMIT} for it; remove command_limit, or wrap the plant with "
                "plant.direct_drive.with_command_limit"
            )
        for duty in plan.duties:
            for drawn in (*plan.draws("tune"), *plan.draws("judge")):
                values = self.values({}, duty, drawn, 0)
                Part(plan.plant).check_values("plant", of_side(PLANT, values))

    def _known(self, side: str) -> dict[str, Parameter]:
        """Parameters of one part, by its own names."""
        return of_side(side, {p.name: p for p in self.loop.parameters})


def composed(plan: Plan, entrant: Entrant) -> Component:
    """The entrant's controller in the form for the study: digital, with the instruments.

    Raises `UserError`.
    """
    from ...plant.instruments.measured_through import measured_through
    from ...plant.instruments.sample_and_hold import PERIOD, sampled

    controller = component(in_units_of(entrant.component, plan.plant))
    if not plan.period:
        return controller
    period = replace(PERIOD, default=plan.period, source="the study")
    if not controller.discrete:
        controller = sampled(controller, period, plan.delay)
    elif controller.sample_time:
        controller = replace(controller, sample_time=period)
    names = (in_units_of(name, plan.plant) for name in plan.instruments)
    parts = [replace(i, sample_time=i.sample_time and period) for i in map(component, names)]
    return measured_through(controller, parts) if parts else controller
