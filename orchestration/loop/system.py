"""The closed loop of an .ssp file of any origin, cut into a plant and the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace

from ...fmus.ports import gain_port, law_ports, rate_port, reference_port
from ...fmus.system_export import SAMPLE_TIME
from ...fmus.system_network import SystemConnection, SystemPort
from ...fmus.system_reading import SystemStructure, read_system
from ...fmus.units import Unit
from ...solver.arrays import Vector
from ...solver.errors import BadParameter, FmuError, nearest
from ...solver.signals import set_point_orders
from ..fmu.fmu_instance import Instance, Value
from ..fmu.group import Feed, Group
from ..fmu.wiring import (
    AS_IS,
    CONTROLLER,
    POSITION,
    Scale,
    Wiring,
    converted,
    from_si,
    plain_outputs,
    scale_of_results,
)
from ..master.march import LoopRun
from ..master.reference_signal import Reference
from .joined import Fmu, Joined, free_input, opened
from .loop import STOP, SystemLoop
from .parts import as_taken, check_names, settable_of

Fmus = Mapping[str, Fmu]
Values = Mapping[str, Mapping[str, Value]]
"""Start values by element."""
Goal = tuple[tuple[SystemConnection, int], ...]
"""Connections of the set-point, and the order of its time derivative for each."""


@contextmanager
def joined_system(asked: SystemLoop) -> Iterator[Joined]:
    """The elements of an .ssp, joined: one is the plant, the others are its controller.

    The plant is the element with feedback-law inputs, else the one called ``plant``, else the one
    whose outputs do not follow its inputs at once and that is not sampled, else the first.

    Raises `FmuError`, `BadParameter` if the file or the request is invalid.
    """
    system = read_system(asked.system)
    with ExitStack() as stack:
        stack.callback(system.remove)
        if system.start != 0.0:
            raise FmuError(f"{system.path}: starts at t = {system.start:g} s, expected 0")
        stop = asked.stop or system.stop or STOP
        replace(asked, stop=stop)  # which checks the step
        fmus: dict[str, Fmu] = {}
        for e in system.elements:
            fmus[e.name] = stack.enter_context(closing(opened(asked, e.fmu, e.name)))
        values = _values(system, asked, fmus)
        cut = _cut(system, fmus, asked)
        reference = asked.reference or Reference.constant(cut.set_point(values))
        yield Joined(
            fmus=fmus,
            values=values,
            main=cut.main,
            sides=cut.sides,
            wiring=cut.wiring,
            names=cut.names,
            reference=reference,
            stop=stop,
            finish=cut.in_units,
            notes=(
                *(f"{name} is unknown in the system and was ignored" for name in system.ignored),
                *_free_inputs(system, cut, values),
                *reference.notes(stop),
            ),
            sampled={},
        )


def _values(system: SystemStructure, asked: SystemLoop, fmus: Fmus) -> Values:
    """Start values by element: those of the file, replaced by those of `asked`."""
    values = {e.name: dict(e.start_values) for e in system.elements}
    for given in system.inputs:
        if (start := given.start) is None:
            continue
        for c in given.drives:
            own = start if isinstance(start, str) else c.factor * start + c.offset
            values[c.target.element].setdefault(c.target.connector, own)
    for name, value in asked.values.items():
        element = max((e for e in values if name.startswith(e + ".")), key=len, default="")
        if not element:
            wanted = name.rpartition(".")[0]
            raise BadParameter(
                f"the system has no element {wanted!r}{nearest(wanted, values)}; it has "
                f"{', '.join(values)}"
            )
        variable, described = name[len(element) + 1 :], fmus[element].description
        check_names(element, [variable], settable_of(described))
        values[element][described.aliases.get(variable, variable)] = value
    return {e: as_taken(e, fmus[e].description, own) for e, own in values.items()}


def _free_inputs(system: SystemStructure, cut: _Cut, values: Values) -> Iterator[str]:
    """Notes on inputs that nothing drives and that are given no value.

    Raises FmuError if nothing measures the plant and an element gets nothing from others.
    """
    driven = {c.target for c in (*system.connections, *(c for c, _ in cut.goal))}
    driven |= {c.target for i in system.inputs for c in i.drives}
    fed = {cut.main, *(c.target.element for c in system.connections)}
    for element, fmu in cut.fmus.items():
        law = law_ports(fmu.inputs, fmu.inputs, fmu.outputs)
        for name in fmu.inputs:
            port = SystemPort(element, name)
            if port in driven or name in law or name in values[element]:
                continue
            if element not in fed and not cut.wiring.signals:
                raise FmuError(
                    f"{system.path}: nothing is connected to the input {port}, and no element has "
                    f"an output of {cut.main!r} as its input; expected a closed loop"
                )
            yield free_input(name, element, fmu)


@dataclass(frozen=True)
class _Cut:
    """A system cut into a plant and the rest."""

    main: str  # the plant
    sides: tuple[Instance, Instance]  # the plant, the rest
    wiring: Wiring
    names: dict[str, str]  # names of the plant's ports in the results
    goal: Goal  # from the set-point in SI units
    # connections into the plant, without those of a law that the master applies
    commands: tuple[SystemConnection, ...]
    fmus: Fmus

    def in_units(self, run: LoopRun) -> LoopRun:
        """Return the run with commands and set-point in the plant's units, and with all units.

        If the plant is within a group, the master has the commands in the units of their sources.
        """
        plant = self.fmus[self.main].description
        units = {v.name: v.unit for v in plant.variables}
        commands, residual = dict(run.commands), dict(run.residual_max)
        given = self._given(run)
        for c in self.commands:
            name, source = c.target.connector, str(c.source)
            fmu = self.fmus[c.source.element]
            if source in given and not fmu.sample_time:
                # the recorded commands of a sampled group are those of the end of the next step
                commands[name] = given[source]
            if isinstance(self.sides[0], Group):
                commands[name] = c.factor * commands[name] + c.offset
                residual[name] *= abs(c.factor)
            if not units[name] and (c.factor, c.offset) == AS_IS:
                units[name] = fmu.description.by_name[c.source.connector].unit
        measured = plant.unit(POSITION) if POSITION in run.outputs else None
        goal = self.goal[0][0].target if self.goal else None
        taken = self.fmus[goal.element].description.unit(goal.connector) if goal else None
        factor, offset = scale_of_results(measured, [taken])
        acting = {str(c.source) for c in self.commands}
        return replace(
            run,
            commands=commands,
            others={n: y for n, y in given.items() if n not in acting},
            residual_max=residual,
            reference=factor * run.reference + offset,
            scale=(factor, offset),
            units={n: units[n] for n in (*run.outputs, *run.commands)},
        )

    def _given(self, run: LoopRun) -> dict[str, Vector]:
        """All recorded outputs of the elements except the plant, as ``element.NAME``."""
        own = next(e for e in self.fmus if e != self.main)
        by = "" if isinstance(self.sides[1], Group) else f"{own}."
        return {by + name.removeprefix(f"{CONTROLLER}."): v for name, v in run.others.items()}

    def set_point(self, values: Values) -> float:
        """The set-point's start value in SI units; NaN if there is no set-point."""
        if not self.goal:
            return math.nan
        goal, _ = self.goal[0]
        element, name = goal.target.element, goal.target.connector
        start = self.fmus[element].description.by_name[name].start or 0.0
        return (float(values[element].get(name, start)) - goal.offset) / (goal.factor or math.nan)


def _cut(system: SystemStructure, fmus: Fmus, asked: SystemLoop) -> _Cut:
    if len(fmus) < 2:
        raise FmuError(f"{system.path}: has one element; a closed loop has two or more")
    plant = _plant(fmus)
    rest = {n: fmu for n, fmu in fmus.items() if n != plant}
    goal = _goal_of(system, fmus, [*rest])
    if asked.reference and not goal:
        raise FmuError(f"{system.path}: has no input for a set-point; set start values instead")
    inside = [c for c in system.connections if plant not in (c.source.element, c.target.element)]
    measured = [c for c in system.connections if c.source.element == plant != c.target.element]
    commands = [c for c in system.connections if c.target.element == plant != c.source.element]
    own = [c for c in system.connections if plant == c.source.element == c.target.element]
    if not commands:
        raise FmuError(f"{system.path}: nothing drives {plant!r}, so it is used as the plant")

    goals = [c for c, _ in goal]
    plain = len(rest) == 1 and not inside and _plain([*measured, *goals], once=True)
    alone = _plain(commands, once=False) and not own
    side: Instance = fmus[plant]
    if not alone:
        side = _grouped("plant", {plant: side}, own, commands, ())
    controller: Instance = next(iter(rest.values()))
    if not plain:
        controller = _grouped("controller", rest, inside, measured, goals)

    def theirs(port: SystemPort) -> str:
        return port.connector if plain else str(port)

    def taken(c: SystemConnection) -> str:
        return c.target.connector if plain else str(c.source)

    ports = {c: _law(c, measured) for c in commands}
    of_law = {port for pairs in ports.values() for _, port in pairs}
    main = [c for c in commands if c.target.connector not in of_law]
    pairs = [pair for c in main for pair in ports[c]]
    accepts = (asked.coupling is None or asked.coupling.law) and alone and bool(main)
    accepts = accepts and all(port in fmus[plant].inputs for _, port in pairs)
    main = main if accepts else commands
    given = {(c.source.connector, c.target.connector) for c in commands}
    network, acting = bool(len(rest) > 1 or own), {c.source for c in commands}
    others = [SystemPort(e, n) for e, fmu in rest.items() for n in plain_outputs(fmu)]
    signals = [(c.source.connector if alone else str(c.source), taken(c)) for c in measured]
    fed = {taken(c): order for c, order in goal}
    wiring = Wiring(
        commands=tuple(
            (theirs(c.source), c.target.connector if alone else str(c.source)) for c in main
        ),
        signals=tuple(dict.fromkeys(signals)),
        references=tuple(fed),
        orders=tuple(fed.values()),
        accepts_law=accepts,
        reports_law=accepts and plain and all(pair in given for pair in pairs),
        others=tuple(theirs(port) for port in others if network or port not in acting),
        network=network,
    )
    names = {f"{plant}.{port}": port for port in fmus[plant].outputs}
    names |= {str(c.source): c.target.connector for c in main} if not alone else {}
    return _Cut(plant, (side, controller), wiring, names, goal, tuple(main), fmus)


def _plant(fmus: Fmus) -> str:
    def rank(name: str) -> tuple[bool, bool, bool]:
        fmu = fmus[name]
        law = bool(law_ports(fmu.inputs, fmu.inputs, fmu.outputs))
        silent = bool(fmu.outputs) and not any(fmu.follows_at_once(y) for y in fmu.outputs)
        return law, name == "plant", silent and SAMPLE_TIME not in fmu.parameters

    return max(fmus, key=rank)  # the first of equals


def _plain(connections: Sequence[SystemConnection], once: bool) -> bool:
    """Whether no connection is scaled; with `once`, also no source drives two ports."""
    joined = all((c.factor, c.offset) == AS_IS for c in connections)
    return joined and (not once or len({c.source for c in connections}) == len(connections))


def _grouped(
    name: str,
    members: Mapping[str, Instance],
    inside: Sequence[SystemConnection],
    outside: Sequence[SystemConnection],
    goal: Sequence[SystemConnection],
) -> Group:
    connections = (*inside, *outside, *goal)
    feeds = [Feed(str(c.source), c.target.element, c.target.connector) for c in connections]
    scales: dict[str, dict[str, Scale]] = {member: {} for member in members}
    for c in connections:
        scales[c.target.element][c.target.connector] = c.factor, c.offset
    scaled = {member: converted(fmu, scales[member]) for member, fmu in members.items()}
    return Group(name, scaled, feeds, list(dict.fromkeys(str(c.source) for c in (*outside, *goal))))


def _goal_of(system: SystemStructure, fmus: Fmus, rest: Sequence[str]) -> Goal:
    """Connections of the set-point: to the system's input, else to an input that nothing drives.

    With an input ``x_d`` also those of the derivatives, ``v_d`` and ``a_d``, as in a loop of two
    parts.
    """
    found = [
        (i.name.rpartition(".")[2], tuple(_from_si(c, i.defined, fmus) for c in i.drives))
        for i in system.inputs
        if i.drives and all(c.target.element in rest for c in i.drives)
    ]
    if not found:
        driven = {c.target for c in system.connections}
        free = [SystemPort(e, p) for e in rest for p in fmus[e].inputs]
        alone = (SystemConnection(SystemPort("", p.connector), p) for p in free if p not in driven)
        found = [(c.source.connector.rpartition(".")[2], (_from_si(c, None, fmus),)) for c in alone]
    orders = set_point_orders([n for n, _ in found])
    return tuple(
        (c, order)
        for name, order in orders.items()
        for n, drives in found
        if n == name
        for c in drives
    )


def _from_si(c: SystemConnection, unit: Unit | None, fmus: Fmus) -> SystemConnection:
    """A connection from the set-point in SI units, for a system's input in `unit`.

    An input without a unit has the unit of the port that it drives.
    """
    unit = unit or fmus[c.target.element].description.unit(c.target.connector)
    if unit is None or unit.exponents is None:
        return c
    factor, offset = from_si(unit)
    return replace(c, factor=c.factor * factor, offset=c.factor * offset + c.offset)


def _law(command: SystemConnection, measured: Sequence[SystemConnection]) -> list[tuple[str, str]]:
    """The law's ports of a command, on the plant's side and on the controller's."""
    source, target = command.source.connector, command.target.connector
    return [
        (rate_port(source), rate_port(target)),
        *(
            (port(source, c.target.connector), port(target, c.source.connector))
            for c in measured
            for port in (gain_port, reference_port)
        ),
    ]
