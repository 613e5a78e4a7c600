"""A controller of a study with its loop: its runs, the values of each, and its tuning."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...solver.errors import UserError
from ...solver.kernel import CONTROLLER, PLANT, ParameterInfo
from ..loop.catalogue import LIMIT, OWN_LIMIT
from ..loop.machine import limit_of
from .figures import Figures, measured
from .loop import AnyLoop, Course
from .plan import Duty, Entrant, Plan
from .tuning import Tuned, price, tune

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
            for end in ends:
                self._check(where, CONTROLLER, name, end)

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

    def _known(self, side: str) -> dict[str, ParameterInfo]:
        """Parameters of one part, by its own names."""
        of_loop = self.loop.parameters
        return {p.name.removeprefix(side): p for p in of_loop if p.name.startswith(side)}

    def _check(self, where: str, side: str, name: str, value: float | None = None) -> None:
        known = self._known(side)
        if name not in known:
            raise UserError(f"{where}: no parameter {name!r}; there are {', '.join(sorted(known))}")
        p = known[name]
        if value is not None and not p.minimum <= value <= p.maximum:
            raise UserError(
                f"{where}: {name} would be {value:g}, expected within [{p.minimum:g}, "
                f"{p.maximum:g}]"
            )
