"""Connections of a plant and a controller: which ports are joined, and the units of their values.

Ports are matched by name, or as mapped by the user. If both sides of a connection declare units in
base units, values are converted; if that is impossible, they are rejected; if one side declares
nothing, values are not converted. The conversions of the law's gains and rates, and of tangents,
follow from those of the signals and commands that they belong to.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np
import numpy.typing as npt

from ...fmus.ports import (
    gain_port,
    law_ports,
    rate_port,
    reference_port,
    tangent_port,
    tangent_states,
)
from ...fmus.units import Unit, conversion
from ...solver.errors import CouplingError, nearest
from ...solver.signals import DERIVATIVES, SET_POINT, set_point_orders
from .fmu_instance import AnyFmu, Instance, Reader, Wrapped, Writer

PLANT, CONTROLLER = "plant", "controller"
POSITION = "x"  # the output that a set-point is compared with
COLUMNS = ("time", SET_POINT)  # of the results, in addition to the plant's
Scale = tuple[float, float]  # factor and offset: result = factor * value + offset
Scales = dict[str, Scale]  # by ports
AS_IS: Scale = (1.0, 0.0)
Kind = TypeVar("Kind", bound=Instance)
Fmu = TypeVar("Fmu", bound=AnyFmu)


@dataclass(frozen=True)
class Wiring:
    """The connections of a loop."""

    commands: tuple[tuple[str, str], ...]  # controller output, plant input
    signals: tuple[tuple[str, str], ...]  # plant output, controller input
    # inputs that take the set-point: the one called ``x_d``, else the only one that nothing drives;
    # with ``x_d`` also those that take its derivatives, ``v_d`` and ``a_d``
    references: tuple[str, ...]
    accepts_law: bool = False  # whether the plant has the law's inputs
    reports_law: bool = False  # whether the controller has its outputs
    orders: tuple[int, ...] = ()  # of the time derivative of each of `references`
    others: tuple[str, ...] = ()  # further outputs of the controller that are recorded
    # whether parts feed each other within a side: their signals and outputs are judged, too
    network: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether no signal is connected in either direction."""
        return not self.commands and not self.signals

    @property
    def driven(self) -> dict[str, set[str]]:
        """Inputs of each side that a connection drives."""
        into = {*(port for _, port in self.signals), *self.references}
        return {PLANT: {port for _, port in self.commands}, CONTROLLER: into}

    def check_given(self, values: Mapping[str, Collection[str]]) -> None:
        """Raise `CouplingError` if a driven input is among the values of a side."""
        for side, ports in self.driven.items():
            for name in (n for n in values[side] if n in ports):
                raise CouplingError(
                    f"{side}.{name} is an input that is connected in the loop; expected a "
                    "parameter or an input that is not connected"
                )

    def plant_law(self) -> list[str]:
        """The plant's inputs except the commands, in the order in which a law is written.

        Gains, one row for each command, references likewise, and rates.
        """
        pairs = [(c, s) for _, c in self.commands for s, _ in self.signals]
        rates = [rate_port(c) for _, c in self.commands]
        return [port(*pair) for port in (gain_port, reference_port) for pair in pairs] + rates

    def controller_law(self) -> list[str]:
        """The controller's outputs except the commands: gains, one row for each command, rates."""
        pairs = [(c, s) for c, _ in self.commands for _, s in self.signals]
        return [gain_port(*pair) for pair in pairs] + [rate_port(c) for c, _ in self.commands]


UNWIRED = Wiring((), (), ())  # stands for connections that are still to be found, by `wire`


def wire(plant: Instance, controller: Instance, mapping: Mapping[str, str] | None = None) -> Wiring:
    """Match the ports of a plant and a controller.

    The mapping is ``theirs -> ours``: a third-party FMU's ports to their partners on the other
    side; ``plant.theirs`` and ``controller.theirs`` are for one side only. Raises `CouplingError`
    if every command of the plant or every measurement of the controller stays unmatched, a name of
    the mapping is no port, two ports would have one name, or the set-point is not given.
    """
    mapping = mapping or {}
    _check_mapping(plant, controller, mapping)
    on_plant = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    ours = names_on(CONTROLLER, [*controller.inputs, *controller.outputs], mapping)
    measured = {on_plant[n]: n for n in plant.outputs}
    law = law_ports(plant.inputs, plant.inputs, plant.outputs)
    needed = {on_plant[n]: n for n in plant.inputs if n not in law}
    commands = tuple((n, needed[ours[n]]) for n in controller.outputs if ours[n] in needed)
    # beside x_d these are the set-point's, also if the plant has such outputs, except if mapped
    orders = set_point_orders([ours[n] for n in controller.inputs])
    own = [n for n in controller.inputs if ours[n] == n and orders.get(n)]
    found = {n: measured[ours[n]] for n in controller.inputs if ours[n] in measured}
    signals = tuple((theirs, n) for n, theirs in found.items() if n not in own)
    if needed and not commands:
        first = next(iter(needed.values()))
        raise CouplingError(
            f"nothing is connected to the input {first!r} of {plant.name}: {controller.name} "
            f"has the outputs {', '.join(controller.outputs) or 'none'}"
            f"{nearest(first, controller.outputs)}; map one of them: THEIRS={first}"
        )
    if not signals and (controller.inputs or controller.outputs):
        raise CouplingError(
            f"{controller.name} has no input that fits an output of {plant.name}: its inputs are "
            f"{', '.join(controller.inputs) or 'none'}, the plant's outputs are "
            f"{', '.join(plant.outputs)}; map one of them: THEIRS=OURS"
        )
    measures = {n for _, n in signals}
    free = {ours[n]: n for n in controller.inputs if n not in measures}
    taken = set_point_orders([*free])
    if free and not taken:
        raise CouplingError(
            f"{controller.name} has the inputs {', '.join(free.values())} that are not connected "
            f"to {plant.name}; map one of them to the set-point: {min(free.values())}={SET_POINT}"
        )
    acting, references = {n for n, _ in commands}, tuple(free[n] for n in taken)
    others = tuple(n for n in plain_outputs(controller) if n not in acting)
    known = Wiring(commands, signals, references, orders=tuple(taken.values()), others=others)
    accepts = bool(commands) and set(known.plant_law()) <= set(plant.inputs)
    reports = set(known.controller_law()) <= set(controller.outputs)
    return replace(known, accepts_law=accepts, reports_law=reports)


def with_aliases(plant: AnyFmu, controller: AnyFmu, mapping: Mapping[str, str]) -> dict[str, str]:
    """The mapping by the ports' own names, and with the aliases that have a partner (FMI 3.0)."""
    found = dict(mapping)
    for side, fmu, other in ((PLANT, plant, controller), (CONTROLLER, controller, plant)):
        theirs = {*other.inputs, *other.outputs}
        known = {*theirs, *other.description.aliases, POSITION, SET_POINT, *DERIVATIVES}
        for alias, port in fmu.description.aliases.items():
            if port not in (*fmu.inputs, *fmu.outputs):
                continue
            own = f"{side}.{port}"
            for key in (f"{side}.{alias}", *([] if alias in theirs else [alias])):
                if key in found:
                    found[own] = found.pop(key)
            taken = {port, own} & {*found, *theirs} or (side == PLANT and alias in COLUMNS)
            if alias in known and not taken:
                found[own] = alias
    return found


def plain_outputs(instance: Instance) -> list[str]:
    """Outputs except those of a feedback law."""
    law = law_ports(instance.outputs, instance.outputs, instance.inputs)
    return [n for n in instance.outputs if n not in law]


def names_on(side: str, ports: Collection[str], mapping: Mapping[str, str]) -> dict[str, str]:
    """Names of a side's ports here; the plant's are never those of a column of the results."""
    called = {n: mapping.get(f"{side}.{n}", mapping.get(n, n)) for n in ports}
    if side == PLANT:
        called |= {n: f"{PLANT}.{n}" for n in ports if called[n] == n and n in COLUMNS}
    return called


def _check_mapping(plant: Instance, controller: Instance, mapping: Mapping[str, str]) -> None:
    """Make sure that every name is a port, and that no port takes the name of another."""
    ports = {
        PLANT: [*plant.outputs, *plant.inputs],
        CONTROLLER: [*controller.inputs, *controller.outputs],
    }
    both = [*ports[PLANT], *ports[CONTROLLER]]
    for theirs in mapping:
        side, _, own = theirs.partition(".")
        where, name = (f"{side} has no", own) if side in ports else ("neither side has a", theirs)
        known = ports.get(side, both)
        if theirs not in both and name not in known:
            raise CouplingError(f"mapping: {where} port {name!r}{nearest(name, known)}")
    of_controller = ((CONTROLLER, own) for own in (controller.inputs, controller.outputs))
    for side, group in ((PLANT, ports[PLANT]), *of_controller):
        called = names_on(side, group, mapping)
        for theirs, ours in ((t, o) for t, o in called.items() if t != o):
            others = [f"{side}'s port {n!r}" for n in called if called[n] == ours and n != theirs]
            if side == PLANT and ours in COLUMNS:
                others.append("a column of the results")
            if others:
                raise CouplingError(
                    f"mapping: {theirs}={ours} has the same name as {others[0]}; map one of them "
                    "to an unused name"
                )


def convert(
    plant: AnyFmu, controller: Fmu, wiring: Wiring, mapping: Mapping[str, str] | None = None
) -> tuple[Fmu, Scale, tuple[str, ...]]:
    """The controller with its ports in the plant's units, or unchanged, and notes.

    Between them is the conversion of the set-point from its SI unit to that of the plant's
    position. Raises `FmuError` or `CouplingError` if units of two ports that are joined do not fit.
    """
    p, c = plant.description, controller.description
    scales: Scales = {}
    one_sided = []  # ports whose unit only one side gives, with that unit
    joined: list[tuple[str, AnyFmu, str, AnyFmu, str]]
    joined = [(n, plant, ours, controller, n) for ours, n in wiring.signals]
    joined += [(n, controller, n, plant, ours) for n, ours in wiring.commands]
    for port, giver, source, taker, target in joined:
        given, taken = giver.description.unit(source), taker.description.unit(target)
        scales[port], only = AS_IS, given or taken
        if given is not None and taken is not None:
            where = f"{giver.name}.{source} to {taker.name}.{target}"
            scales[port] = conversion(given, taken, where)
        elif only is not None and not only.is_plain:
            one_sided.append(f"{port} [{only.name}]")
    one_sided += _add_set_points(scales, plant, controller, wiring)
    for u, _ in wiring.commands:
        scales[rate_port(u)] = scales[u][0], 0.0
        scales |= {gain_port(u, y): (scales[u][0] * scales[y][0], 0.0) for _, y in wiring.signals}
    tangents = range(1, tangent_states(list(controller.parameters))[1] + 1)
    scales |= {tangent_port(n, k): (f, 0.0) for n, (f, _) in [*scales.items()] for k in tangents}
    names = ", ".join(one_sided)
    note = f"only one side gives the unit of {names}: these values are not converted"
    called = names_on(PLANT, p.names("output"), mapping or {})
    position = next((p.unit(n) for n, name in called.items() if name == POSITION), None)
    of_position = [y for ours, y in wiring.signals if called[ours] == POSITION]
    goals = [n for n, order in zip(wiring.references, wiring.orders, strict=True) if order == 0]
    set_point = scale_of_results(position, [c.unit(n) for n in (*goals, *of_position)])
    return converted(controller, scales), set_point, (note,) if names else ()


def _add_set_points(scales: Scales, plant: AnyFmu, controller: AnyFmu, wiring: Wiring) -> list[str]:
    """Add conversions of set-points; return those without a defined unit if others are not SI."""
    measured = [plant.description.unit(ours) for ours, _ in wiring.signals]
    own = [controller.description.unit(theirs) for _, theirs in wiring.signals]
    others = any(u is not None and u.factor != 1.0 for u in (*measured, *own))
    defined = [u for u in measured if u is not None and u.exponents is not None]
    untold = []
    for name, order in zip(wiring.references, wiring.orders, strict=True):
        unit = controller.description.unit(name)
        if unit is None or unit.exponents is None:
            untold += [f"{name} (the set-point)"] if others or unit is not None else []
            continue
        scales[name] = from_si(unit, order)
        fits = unit.exponents in [u.exponents for u in defined]
        if order == 0 and measured and len(defined) == len(measured) and not fits:
            raise CouplingError(
                f"{controller.name}.{name} has the set-point in {unit.name!r}, but no signal that "
                f"{controller.name} measures is of this quantity: it measures values in "
                f"{', '.join(u.name for u in defined)}"
            )
    return untold


def from_si(unit: Unit, order: int = 0) -> Scale:
    """Conversion from SI units to a unit, also for a derivative by time of this order."""
    return 1.0 / unit.factor, 0.0 if order or unit.relative else -unit.offset / unit.factor


def scale_of_results(position: Unit | None, units: Sequence[Unit | None]) -> Scale:
    """From the set-point's SI unit to the one of the plant's position, as `LoopRun.scale`.

    It is not converted if none fits of the `units` that the controller has of both.
    """
    if position is None or position.exponents is None:
        return AS_IS
    fits = any(unit and unit.exponents == position.exponents for unit in units)
    return from_si(position) if fits else AS_IS


def converted(instance: Kind, scales: Mapping[str, Scale]) -> Kind:
    """The instance with its ports in other units; itself if nothing changes.

    Scales of inputs are from the given unit to its own, of outputs from its own to the given.
    Parameters and start values stay in its own units.
    """
    changed = {name: scale for name, scale in scales.items() if scale != AS_IS}
    return cast("Kind", _Converted(instance, changed)) if changed else instance


class _Converted(Wrapped):
    def __init__(self, instance: Instance, scales: Mapping[str, Scale]) -> None:
        super().__init__(instance)
        self._scales = scales

    def nominal(self, name: str) -> float:
        factor = abs(self._scales.get(name, AS_IS)[0])
        own = self._instance.nominal(name)
        return own / (factor or 1.0) if name in self._instance.inputs else own * factor

    def _arrays(self, names: Sequence[str]) -> npt.NDArray[np.float64]:
        """Factors and offsets."""
        return np.array([self._scales.get(name, AS_IS) for name in names]).reshape(-1, 2).T

    def writer(self, names: Sequence[str]) -> Writer:
        write, (factors, offsets) = self._instance.writer(names), self._arrays(names)
        return lambda values: write(factors * values + offsets)

    def reader(self, names: Sequence[str]) -> Reader:
        read, (factors, offsets) = self._instance.reader(names), self._arrays(names)
        return lambda: factors * read() + offsets

    def reopened(self) -> _Converted:
        return _Converted(self._instance.reopened(), self._scales)
