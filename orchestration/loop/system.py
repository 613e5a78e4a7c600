"""The closed loop of an .ssp file of any origin, cut into a plant and the rest."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...fmus.ports import gain_port, law_ports, rate_port, reference_port
from ...fmus.system_network import SystemConnection, SystemPort
from ...fmus.system_reading import SystemStructure, read_system
from ...fmus.units import Unit
from ...solver.errors import BadParameter, FmuError, nearest
from ...solver.set_point import set_point_orders
from ..fmu.fmu_instance import SAMPLE_TIME, Instance, Value
from ..fmu.group import Feed, Group
from ..fmu.isolated import open_fmu
from ..fmu.limits import check_step
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
from ..master.couplings import Coupling
from ..master.loop_run import LoopRun
from ..master.reference_signal import Reference
from .catalogue import LIMIT
from .joined import Fmu, Joined
from .loop import STOP, SystemLoop
from .parts import as_taken, check_names, settable_of

Vector = npt.NDArray[np.float64]
Fmus = Mapping[str, Fmu]
Goal = tuple[tuple[SystemConnection, int], ...]
"""Connections of the set-point, and the order of its time derivative for each."""


@contextlib.contextmanager
def joined_system(asked: SystemLoop) -> Iterator[Joined]:
    """The elements of an .ssp, joined: one is the plant, the others are its controller.

    The plant is the element with feedback-law inputs, else the one called ``plant``, else the one
    whose outputs do not follow its inputs at once and that is not sampled, else the first.

    Raises `FmuError`, `BadParameter` if the file or the request is invalid.
    """
    system = read_system(asked.system)
    with contextlib.ExitStack() as opened:
        opened.callback(system.remove)
        if system.start != 0.0:
            raise FmuError(f"{system.path}: starts at t = {system.start:g} s, expected 0")
        stop = asked.stop or system.stop or STOP
        if asked.step is not None:
            check_step("step", asked.step, stop)
        fmus = {}
        for e in system.elements:
            fmus[e.name] = open_fmu(e.fmu, e.name, asked.isolate, asked.time_limit)
            opened.callback(fmus[e.name].close)
        values = _values(system, asked, fmus)
        cut = _cut(system, fmus, asked)
        free = _free_inputs(system, cut, values)
        reference = asked.reference or Reference.constant(cut.set_point(values))
        notes = [f"{name} is unknown in the system and was ignored" for name in system.ignored]
        notes += [
            f"nothing is connected to the input {port.connector!r} of {port.element}: it stays at "
            f"{start:g}; --set {port}=VALUE gives it a value"
            for port, start in free.items()
        ]
        yield Joined(
            fmus=fmus,
            values=values,
            main=cut.plant_name,
            sides=(cut.plant, cut.controller),
            side_values=(
                _of_side(cut.plant, [cut.plant_name], values),
                _of_side(cut.controller, [n for n in fmus if n != cut.plant_name], values),
            ),
            wiring=cut.wiring,
            names=cut.names,
            reference=reference,
            stop=stop,
            finish=cut.in_units,
            notes=(*notes, *reference.notes(stop)),
            limit_option=f"--set {cut.plant_name}.{LIMIT}=",
            sampled={},
        )


def _values(system: SystemStructure, asked: SystemLoop, fmus: Fmus) -> dict[str, dict[str, Value]]:
    """Start values by element: those of the file, replaced by those of `asked`."""
    values = {e.name: dict(e.start_values) for e in system.elements}
    for given in system.inputs:
        if given.start is not None:
            for c in given.drives:
                start = given.start
                if not isinstance(start, str):
                    start = c.factor * start + c.offset
                values[c.target.element].setdefault(c.target.connector, start)
    for name, value in asked.values.items():
        element = max((e for e in values if name.startswith(e + ".")), key=len, default="")
        if not element:
            wanted = name.rpartition(".")[0]
            raise BadParameter(
                f"the system has no element {wanted!r}{nearest(wanted, values)}; it has "
                f"{', '.join(values)}"
            )
        variable = name[len(element) + 1 :]
        check_names(element, [variable], settable_of(fmus[element].description))
        values[element][fmus[element].description.aliases.get(variable, variable)] = value
    return {e: as_taken(e, fmus[e].description, own) for e, own in values.items()}


def _free_inputs(
    system: SystemStructure, cut: _Cut, values: Mapping[str, Mapping[str, Value]]
) -> dict[SystemPort, float]:
    """Inputs that nothing drives and that are given no value, with their start values.

    Raises FmuError if nothing measures the plant and an element gets nothing from others.
    """
    driven = {c.target for c in (*system.connections, *(c for c, _ in cut.goal))}
    driven |= {c.target for i in system.inputs for c in i.drives}
    found: dict[SystemPort, float] = {}
    for element, fmu in cut.fmus.items():
        law = law_ports(fmu.inputs, fmu.inputs, fmu.outputs)
        for name in fmu.inputs:
            port = SystemPort(element, name)
            if port not in driven and name not in law and name not in values[element]:
                found[port] = fmu.description.by_name[name].start or 0.0
    fed = {cut.plant_name, *(c.target.element for c in system.connections)}
    blind = [port for port in found if port.element not in fed]
    if blind and not cut.wiring.signals:
        raise FmuError(
            f"{system.path}: nothing is connected to the input {blind[0]}, and no element has an "
            f"output of {cut.plant_name!r} as its input; expected a closed loop"
        )
    return found


def _of_side(
    side: Instance, elements: Sequence[str], values: Mapping[str, Mapping[str, Value]]
) -> dict[str, Value]:
    if isinstance(side, Group):
        return {f"{e}.{name}": v for e in elements for name, v in values[e].items()}
    return dict(values[elements[0]])


@dataclass(frozen=True)
class _Cut:
    """A system cut into a plant and the rest."""

    plant_name: str
    plant: Instance
    controller: Instance
    wiring: Wiring
    names: dict[str, str]  # names of the plant's ports in the results
    # connections from the set-point in SI units, and the order of its time derivative for each
    goal: Goal
    # connections into the plant, without those of a law that the master applies
    commands: tuple[SystemConnection, ...]
    fmus: Fmus

    def in_units(self, run: LoopRun) -> LoopRun:
        """Return the run with commands and set-point in the plant's units, and with all units.

        If the plant is within a group, the master has the commands in the units of their sources.
        """
        plant = self.fmus[self.plant_name].description
        units = {v.name: v.unit for v in plant.variables}
        commands, residual = dict(run.commands), dict(run.residual_max)
        given = self._given(run)
        for c in self.commands:
            name, source = c.target.connector, str(c.source)
            if source in given and not self.fmus[c.source.element].sample_time:
                # the recorded commands of a sampled group are those of the end of the next step
                commands[name] = given[source]
            if isinstance(self.plant, Group):
                commands[name] = c.factor * commands[name] + c.offset
                residual[name] *= abs(c.factor)
            if not units[name] and (c.factor, c.offset) == AS_IS:
                variables = self.fmus[c.source.element].description.variables
                units[name] = next(v.unit for v in variables if v.name == c.source.connector)
        measured = plant.unit(POSITION) if POSITION in run.outputs else None
        goal = self.goal[0][0].target if self.goal else None
        taken = self.fmus[goal.element].description.unit(goal.connector) if goal else None
        factor, offset = scale_of_results(measured, [taken])
        return replace(
            run,
            commands=commands,
            others={
                n: y for n, y in given.items() if n not in {str(c.source) for c in self.commands}
            },
            residual_max=residual,
            reference=factor * run.reference + offset,
            scale=(factor, offset),
            units={n: units[n] for n in (*run.outputs, *run.commands)},
        )

    def _given(self, run: LoopRun) -> dict[str, Vector]:
        """All recorded outputs of the elements except the plant, as ``element.NAME``."""
        own = next(e for e in self.fmus if e != self.plant_name)
        by = "" if isinstance(self.controller, Group) else f"{own}."
        return {by + name.removeprefix(f"{CONTROLLER}."): v for name, v in run.others.items()}

    def set_point(self, values: Mapping[str, Mapping[str, Value]]) -> float:
        """The set-point's start value in SI units; NaN if there is no set-point."""
        if not self.goal:
            return math.nan
        goal, _ = self.goal[0]
        target = goal.target
        given = values[target.element].get(target.connector)
        if given is None:
            variables = self.fmus[target.element].description.variables
            given = next(v.start for v in variables if v.name == target.connector) or 0.0
        return (float(given) - goal.offset) / (goal.factor or math.nan)


def _cut(system: SystemStructure, fmus: Fmus, asked: SystemLoop) -> _Cut:
    if len(fmus) < 2:
        raise FmuError(f"{system.path}: has one element; a closed loop has two or more")
    plant = _plant(fmus)
    rest = [n for n in fmus if n != plant]
    goal = _goal_of(system, fmus, rest)
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
    controller: Instance = (
        fmus[rest[0]]
        if plain
        else _grouped("controller", {n: fmus[n] for n in rest}, inside, measured, goals)
    )
    side: Instance = fmus[plant]
    if not alone:
        side = _grouped("plant", {plant: side}, own, commands, ())

    def theirs(port: SystemPort) -> str:
        return port.connector if plain else str(port)

    def ours(port: SystemPort) -> str:
        return port.connector if alone else str(port)

    signals = tuple(
        dict.fromkeys(
            (ours(c.source), c.target.connector if plain else str(c.source)) for c in measured
        )
    )
    fed = {c.target.connector if plain else str(c.source): order for c, order in goal}
    ports = {c: _law(c, measured) for c in commands}
    of_law = {port for pairs in ports.values() for _, port in pairs}
    main = [c for c in commands if c.target.connector not in of_law]
    pairs = [pair for c in main for pair in ports[c]]
    accepts = asked.coupling in (None, Coupling.INTERFACE_JACOBIAN) and alone and bool(main)
    accepts = accepts and all(port in fmus[plant].inputs for _, port in pairs)
    main = main if accepts else commands
    given = {(c.source.connector, c.target.connector) for c in commands}
    network = bool(len(rest) > 1 or own)
    others = [
        port
        for port in (SystemPort(e, n) for e in rest for n in plain_outputs(fmus[e]))
        if network or port not in {c.source for c in commands}
    ]
    wiring = Wiring(
        commands=tuple(
            (theirs(c.source), c.target.connector if alone else str(c.source)) for c in main
        ),
        signals=signals,
        references=tuple(fed),
        orders=tuple(fed.values()),
        accepts_law=accepts,
        reports_law=accepts and plain and all(pair in given for pair in pairs),
        others=tuple(map(theirs, others)),
        network=network,
    )
    names = {f"{plant}.{port}": port for port in fmus[plant].outputs}
    names |= {str(c.source): c.target.connector for c in main} if not alone else {}
    return _Cut(plant, side, controller, wiring, names, goal, tuple(main), fmus)


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
    candidates: dict[str, tuple[SystemConnection, ...]] = {
        i.name: tuple(_from_si(c, i.defined, fmus) for c in i.drives)
        for i in system.inputs
        if i.drives and all(c.target.element in rest for c in i.drives)
    }
    if not candidates:
        driven = {c.target for c in system.connections}
        free = [SystemPort(e, p) for e in rest for p in fmus[e].inputs]
        candidates = {
            str(port): (
                _from_si(SystemConnection(SystemPort("", port.connector), port), None, fmus),
            )
            for port in free
            if port not in driven
        }
    called = [(n.rpartition(".")[2], drives) for n, drives in candidates.items()]
    orders = set_point_orders([n for n, _ in called])
    return tuple(
        (c, order)
        for name, order in orders.items()
        for n, drives in called
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
