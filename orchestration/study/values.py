"""Parameters of the runs of a study: of the amplifier, the duty, the drawn plant, the tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from ...instruments import NOMINAL_VOLTAGE, UNLIMITED
from ...solver.kernel import CONTROLLER, PLANT, ParameterInfo
from ..catalogue import OWN_LIMIT
from .plan import Duty, Entrant, Plan
from .reading import BadPlan

LIMIT = "voltage_limit"  # the plant's parameter, for any unit of its command
AMPLIFIER = "current_limit"  # a plant that has it is driven by volts, through an amplifier
SEED = "_seed"  # end of the name of a noise's seed


class HasParameters(Protocol):
    """A loop's kernel, or a loop with an FMU."""

    @property
    def parameters(self) -> Sequence[ParameterInfo]: ...


BETWEEN_SOURCES = 1_000_000  # difference of the seeds of two noises


def values_for(
    plan: Plan,
    kernel: HasParameters,
    entrant: Entrant,
    tuned: Mapping[str, float],
    duty: Duty,
    drawn: Sequence[float],
    number: int,
) -> dict[str, float]:
    """Parameters of a run, by the loop's names, that differ from their defaults.

    Noise sources get seeds that follow from the number of the draw: the same for all controllers
    and duties on a plant, different ones on other plants, and a different one for each source.

    Parameters
    ----------
    kernel : HasParameters
        Of the closed loop.
    tuned : mapping of str to float
        Of the controller.
    drawn : sequence of float
        The draws of the plant, one for each variation; their factors are on the nominal value, or
        on that of the duty.
    number : int
        Of the drawn plant, from 0.
    """
    known = {p.name: p.default for p in kernel.parameters}
    limit = limit_of(plan, kernel)
    values = {n: limit for n in (PLANT + LIMIT, CONTROLLER + OWN_LIMIT) if n in known}
    values |= {PLANT + n: v for n, v in duty.plant.items()}
    for variation, draw in zip(plan.variations, drawn, strict=True):
        for name, factor in variation.factors(draw).items():
            values[PLANT + name] = values.get(PLANT + name, known[PLANT + name]) * factor
    values |= {CONTROLLER + n: v for n, v in {**entrant.values, **tuned}.items()}
    sources = sorted(n for n in known if n.endswith(SEED))
    return values | {n: float(1 + number + k * BETWEEN_SOURCES) for k, n in enumerate(sources)}


def limit_of(plan: Plan, kernel: HasParameters) -> float:
    """Largest command of plant and controllers, in the unit of the plant's command.

    The limit of the plan; else the nominal amplifier's 36 V if the plant has an amplifier, and no
    limit for others: a limit in volts has no meaning if the command is a force.
    """
    if plan.command_limit is not None:
        return plan.command_limit
    known = [p.name for p in kernel.parameters]
    return NOMINAL_VOLTAGE if PLANT + AMPLIFIER in known else UNLIMITED


def check_controller(entrant: Entrant, kernel: HasParameters) -> None:
    """Check that all parameters that are set or tuned exist and stay in their range.

    Raises
    ------
    BadPlan
    """
    where = f"controllers.{entrant.name}"
    asked = [(n, (value,)) for n, value in entrant.values.items()]
    for name, ends in [*asked, *entrant.tune.items()]:
        _check_known(where, CONTROLLER, name, kernel)
        for end in ends:
            _check_range(where, CONTROLLER, name, end, kernel)


def check_plants(plan: Plan, kernel: HasParameters) -> None:
    """Make sure that all plants are possible: of each duty, as drawn, and at the ends of ranges.

    Raises
    ------
    BadPlan
    """
    if plan.command_limit is not None and PLANT + LIMIT not in [p.name for p in kernel.parameters]:
        raise BadPlan(
            f"command_limit is {plan.command_limit:g}, and {plan.plant} has no parameter {LIMIT} "
            "for it; remove command_limit, or wrap the plant with "
            "plant.direct_drive.with_command_limit"
        )
    for duty in plan.duties:
        for name, value in duty.plant.items():
            _check_known(f"duty {duty.name}", PLANT, name, kernel)
            _check_range(f"duty {duty.name}", PLANT, name, value, kernel)
    for variation in plan.variations:
        for name in variation.parameters:
            _check_known("vary", PLANT, name, kernel)
    for duty in plan.duties:
        for row in plan.rows_to_check():
            values = values_for(plan, kernel, plan.entrants[0], {}, duty, row, 0)
            for variation in plan.variations:
                for name in variation.parameters:
                    _check_range("vary", PLANT, name, values[PLANT + name], kernel)


def _check_known(where: str, side: str, name: str, kernel: HasParameters) -> None:
    known = [p.name for p in kernel.parameters if p.name.startswith(side)]
    if side + name not in known:
        there = ", ".join(sorted(n.removeprefix(side) for n in known))
        raise BadPlan(f"{where}: no parameter {name!r}; there are {there}")


def _check_range(where: str, side: str, name: str, value: float, kernel: HasParameters) -> None:
    (p,) = (p for p in kernel.parameters if p.name == side + name)
    if not p.minimum <= value <= p.maximum:
        raise BadPlan(
            f"{where}: {name} would be {value:g}, expected within [{p.minimum:g}, {p.maximum:g}]"
        )
