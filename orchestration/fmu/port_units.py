"""Unit conversions between a plant and a controller, one for each port of the controller.

If both sides declare units in base units, values are converted; if that is impossible, they are
rejected; if one side declares nothing, values are not converted. The conversions of the law's gains
and rates, and of tangents, follow from those of the signals and commands that they belong to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...fmus.ports import gain_port, rate_port, tangent_port, tangent_states
from ...fmus.reading import Description
from ...fmus.units import Unit, conversion
from ...solver.errors import CouplingError, FmuError
from .fmu_instance import FmuInstance
from .isolated import IsolatedInstance
from .wiring import PLANT, POSITION, Wiring, names_on
from .wrappers import AS_IS, Scale, converted


@dataclass(frozen=True)
class PortUnits:
    """Conversions of the values between a plant and a controller."""

    # by port of the controller: of inputs from the plant's unit, or SI for a set-point, to its own;
    # of outputs from its own to the plant's
    scales: dict[str, Scale]
    set_point: Scale  # from its SI unit to the unit of the plant's position, for results
    one_sided: tuple[str, ...]  # ports whose unit only one side gives, with that unit
    commands: dict[str, str]  # unit of each driven input of the plant: its own, else the other's

    @property
    def notes(self) -> tuple[str, ...]:
        if not self.one_sided:
            return ()
        return (
            f"only one side gives the unit of {', '.join(self.one_sided)}: these values "
            "are not converted",
        )


def port_units(
    plant: FmuInstance | IsolatedInstance,
    controller: FmuInstance | IsolatedInstance,
    wiring: Wiring,
    mapping: Mapping[str, str] | None = None,
) -> PortUnits:
    """The conversions between two FMUs.

    Raises
    ------
    CouplingError
        If the units of two ports that are joined cannot be converted.
    """
    p, c = plant.description, controller.description
    scales: dict[str, Scale] = {}
    one_sided = []
    for ours, theirs in wiring.signals:
        where = f"{plant.name}.{ours} to {controller.name}.{theirs}"
        scales[theirs] = _between(p.unit(ours), c.unit(theirs), where)
        one_sided += _one_sided(theirs, p.unit(ours), c.unit(theirs))
    for theirs, ours in wiring.commands:
        where = f"{controller.name}.{theirs} to {plant.name}.{ours}"
        scales[theirs] = _between(c.unit(theirs), p.unit(ours), where)
        one_sided += _one_sided(theirs, c.unit(theirs), p.unit(ours))
    set_point = _of_results(p, c, wiring, mapping or {})
    one_sided += _add_set_points(scales, plant, controller, wiring)
    _add_law(scales, wiring)
    count = tangent_states(list(controller.parameters))[1]
    scales |= {
        tangent_port(name, k + 1): (factor, 0.0)
        for name, (factor, _) in list(scales.items())
        for k in range(count)
    }
    units = {v.name: v.unit for v in p.variables}, {v.name: v.unit for v in c.variables}
    return PortUnits(
        scales,
        set_point,
        tuple(one_sided),
        {ours: units[0][ours] or units[1][theirs] for theirs, ours in wiring.commands},
    )


def _between(given: Unit | None, taken: Unit | None, where: str) -> Scale:
    if given is None or taken is None:
        return AS_IS
    try:
        return conversion(given, taken, where)
    except FmuError as error:
        raise CouplingError(str(error)) from error


def _one_sided(port: str, *units: Unit | None) -> list[str]:
    told = [unit for unit in units if unit is not None]
    if len(told) != 1 or told[0].is_plain:
        return []
    return [f"{port} [{told[0].name}]"]


def from_si(unit: Unit, order: int = 0) -> Scale:
    """Conversion from SI units to a unit, also for a derivative by time of this order."""
    return 1.0 / unit.factor, 0.0 if order or unit.relative else -unit.offset / unit.factor


def _add_set_points(
    scales: dict[str, Scale],
    plant: FmuInstance | IsolatedInstance,
    controller: FmuInstance | IsolatedInstance,
    wiring: Wiring,
) -> list[str]:
    """Add conversions of set-points; return those without a defined unit if others are not SI."""
    measured = [plant.description.unit(ours) for ours, _ in wiring.signals]
    own = [controller.description.unit(theirs) for _, theirs in wiring.signals]
    others = any(u is not None and u.factor != 1.0 for u in (*measured, *own))
    untold = []
    for name, order in zip(wiring.references, wiring.orders, strict=True):
        unit = controller.description.unit(name)
        if unit is None or unit.exponents is None:
            untold += [f"{name} (the set-point)"] if others or unit is not None else []
            continue
        scales[name] = from_si(unit, order)
        known = [m.exponents for m in measured if m is not None and m.exponents is not None]
        if order == 0 and len(known) == len(measured) and known and unit.exponents not in known:
            names = ", ".join(m.name for m in measured if m is not None)
            raise CouplingError(
                f"{controller.name}.{name} has the set-point in {unit.name!r}, but no signal that "
                f"{controller.name} measures is of this quantity: it measures values in {names}"
            )
    return untold


def _add_law(scales: dict[str, Scale], wiring: Wiring) -> None:
    """Add conversions of gains and rates, which follow from those of commands and signals."""
    for u, _ in wiring.commands:
        of_command = scales[u][0]
        scales[rate_port(u)] = of_command, 0.0
        for _, y in wiring.signals:
            scales[gain_port(u, y)] = of_command * scales[y][0], 0.0


def _of_results(
    plant: Description, controller: Description, wiring: Wiring, mapping: Mapping[str, str]
) -> Scale:
    called = names_on(PLANT, plant.names("output"), mapping)
    position = next((plant.unit(n) for n, ours in called.items() if ours == POSITION), None)
    compared = [y for ours, y in wiring.signals if called[ours] == POSITION]
    goals = [n for n, order in zip(wiring.references, wiring.orders, strict=True) if order == 0]
    return scale_of_results(position, [controller.unit(n) for n in (*goals, *compared)])


def scale_of_results(position: Unit | None, told: Sequence[Unit | None]) -> Scale:
    """From the set-point's SI unit to the one of the plant's position, as `LoopRun.scale`.

    The controller's units of the set-point and of the position that it compares are `told`; if none
    of them fits, the set-point is not converted.
    """
    if position is None or position.exponents is None:
        return AS_IS
    fits = any(unit and unit.exponents == position.exponents for unit in told)
    return from_si(position) if fits else AS_IS


def convert(
    plant: FmuInstance | IsolatedInstance,
    controller: FmuInstance | IsolatedInstance,
    wiring: Wiring,
    mapping: Mapping[str, str] | None = None,
) -> tuple[FmuInstance | IsolatedInstance, PortUnits]:
    """The controller with its ports in the plant's units, or unchanged; and the conversions.

    Raises
    ------
    CouplingError
        If the units of two ports that are joined cannot be converted.
    """
    units = port_units(plant, controller, wiring, mapping)
    return converted(controller, units.scales), units
