"""The FMUs of a loop, joined: of a pair, or of an .ssp, cut into a plant and the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

from ...fmus.ports import gain_port, law_ports, rate_port, reference_port
from ...fmus.system_export import SAMPLE_TIME
from ...fmus.system_network import SystemConnection, SystemPort
from ...fmus.system_reading import SystemStructure, read_system
from ...fmus.units import Unit
from ...solver.errors import BadParameter, FmuError, nearest
from ...solver.signals import set_point_orders
from ..fmu.fmu_instance import Instance, Value
from ..fmu.group import Feed, Group
from ..fmu.isolated import open_fmu
from ..fmu.wiring import POSITION, Wiring, converted, from_si, plain_outputs, scale_of_results
from ..master.reference_signal import Reference
from .joined import Fmu, Joined, as_is, free_input, join_pair
from .loop import STOP, HowCoupled, Loop, SystemLoop
from .parts import as_taken, check_names, settable_of

Fmus = Mapping[str, Fmu]
Values = Mapping[str, Mapping[str, Value]]  # start values by element
Connections = Sequence[SystemConnection]
Goal = tuple[tuple[SystemConnection, int], ...]  # of the set-point, with orders of derivatives


@contextmanager
def joined(loop: Loop | SystemLoop) -> Iterator[Joined]:
    """Both sides of a loop of FMUs, open and joined; closed at the end."""
    with ExitStack() as stack:

        def opening(path: Path, name: str) -> Fmu:
            return stack.enter_context(closing(open_fmu(path, name, loop.isolate, loop.time_limit)))

        if isinstance(loop, Loop):
            yield join_pair(loop, opening)
        else:
            system = read_system(loop.system)
            stack.callback(system.remove)
            fmus = {e.name: opening(e.fmu, e.name) for e in system.elements}
            yield join_system(loop, system, fmus)


def join_system(asked: SystemLoop, system: SystemStructure, fmus: Fmus) -> Joined:
    """The elements of an .ssp, joined: one is the plant, the others are its controller.

    The plant is the element with feedback-law inputs, else the one called ``plant``, else the one
    whose outputs do not follow its inputs at once and that is not sampled, else the first.

    Raises `FmuError`, `BadParameter` if the file or the request is invalid.
    """
    if system.start != 0.0:
        raise FmuError(f"{system.path}: starts at t = {system.start:g} s, expected 0")
    stop = asked.stop or system.stop or STOP
    asked = replace(asked, stop=stop)  # which checks the step
    values = _values(system, asked, fmus)
    if len(fmus) < 2:
        raise FmuError(f"{system.path}: has one element; a closed loop has two or more")
    main = max(fmus, key=lambda name: _likeness(name, fmus[name]))  # the first of equals
    goal = _goal_of(system, fmus, [n for n in fmus if n != main])
    if asked.reference and not goal:
        raise FmuError(f"{system.path}: has no input for a set-point; set start values instead")
    reference = asked.reference or Reference.constant(_set_point(goal, fmus, values))
    sides, wiring, commands = _cut(system, fmus, main, goal, asked)
    described = fmus[main].description
    measured = described.unit(POSITION) if POSITION in fmus[main].outputs else None
    of_goal = [fmus[c.target.element].description.unit(c.target.connector) for c, _ in goal[:1]]
    names = {f"{main}.{port}": port for port in fmus[main].outputs}
    if isinstance(sides[0], Group):
        names |= {str(c.source): c.target.connector for c in commands}
    ignored = (f"{name} is unknown in the system and was ignored" for name in system.ignored)
    free = _free_inputs(system, fmus, values, main, goal, bool(wiring.signals))
    notes = (*ignored, *free, *reference.notes(stop))
    joint = wiring, names, commands, scale_of_results(measured, of_goal), reference, stop, notes
    return Joined(asked, fmus, values, main, sides, *joint)


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
            hint = f"{nearest(wanted, values)}; it has {', '.join(values)}"
            raise BadParameter(f"the system has no element {wanted!r}{hint}")
        variable, described = name[len(element) + 1 :], fmus[element].description
        check_names(element, [variable], settable_of(described))
        values[element][described.aliases.get(variable, variable)] = value
    return {e: as_taken(e, fmus[e].description, own) for e, own in values.items()}


def _likeness(name: str, fmu: Fmu) -> tuple[bool, bool, bool]:
    """How much an element is like a plant."""
    law = bool(law_ports(fmu.inputs, fmu.inputs, fmu.outputs))
    silent = bool(fmu.outputs) and not any(map(fmu.follows_at_once, fmu.outputs))
    return law, name == "plant", silent and SAMPLE_TIME not in fmu.parameters


def _goal_of(system: SystemStructure, fmus: Fmus, rest: Sequence[str]) -> Goal:
    """Connections of the set-point: to the system's input, else to an input that nothing drives."""
    found = [
        (i.name, [_from_si(c, i.defined, fmus) for c in i.drives])
        for i in system.inputs
        if i.drives and all(c.target.element in rest for c in i.drives)
    ]
    if not found:
        driven = {c.target for c in system.connections}
        ports = (SystemPort(e, n) for e in rest for n in fmus[e].inputs)
        free = ((p.connector, p) for p in ports if p not in driven)
        drives = ((n, SystemConnection(SystemPort("", n), p)) for n, p in free)
        found = [(n, [_from_si(c, None, fmus)]) for n, c in drives]
    short = [(name.rpartition(".")[2], drives) for name, drives in found]
    orders = set_point_orders([n for n, _ in short]).items()
    return tuple((c, order) for name, order in orders for n, own in short if n == name for c in own)


def _from_si(c: SystemConnection, unit: Unit | None, fmus: Fmus) -> SystemConnection:
    """A connection from the set-point in SI units; the system's input or the port has a unit."""
    unit = unit or fmus[c.target.element].description.unit(c.target.connector)
    if unit is None or unit.exponents is None:
        return c
    factor, offset = from_si(unit)
    return replace(c, factor=c.factor * factor, offset=c.factor * offset + c.offset)


def _set_point(goal: Goal, fmus: Fmus, values: Values) -> float:
    """The set-point's start value in SI units; NaN if there is no set-point."""
    if not goal:
        return math.nan
    c, (element, name) = goal[0][0], (goal[0][0].target.element, goal[0][0].target.connector)
    start = fmus[element].description.by_name[name].start or 0.0
    return (float(values[element].get(name, start)) - c.offset) / (c.factor or math.nan)


def _cut(
    system: SystemStructure, fmus: Fmus, plant: str, goal: Goal, how: HowCoupled
) -> tuple[tuple[Instance, Instance], Wiring, tuple[SystemConnection, ...]]:
    """Plant and controller, what joins them, and the commands without those of a law."""
    at = [(c, (c.source.element == plant, c.target.element == plant)) for c in system.connections]
    own, measured, commands, inside = (
        [c for c, found in at if found == ends] for ends in product((True, False), repeat=2)
    )
    if not commands:
        raise FmuError(f"{system.path}: nothing drives {plant!r}, so it is used as the plant")
    rest = {n: fmu for n, fmu in fmus.items() if n != plant}
    goals = [c for c, _ in goal]
    into = [*measured, *goals]
    once = len({c.source for c in into}) == len(into)
    plain = len(rest) == 1 and not inside and once and as_is(*into)
    alone = as_is(*commands) and not own
    side: Instance = fmus[plant]
    if not alone:
        side = _grouped("plant", {plant: side}, own, commands)
    controller: Instance = next(iter(rest.values()))
    if not plain:
        controller = _grouped("controller", rest, inside, into)

    def theirs(port: SystemPort) -> str:
        return port.connector if plain else str(port)

    def taken(c: SystemConnection) -> str:
        return c.target.connector if plain else str(c.source)

    ports = {c: _law(c, measured) for c in commands}
    of_law = {port for pairs in ports.values() for _, port in pairs}
    main = [c for c in commands if c.target.connector not in of_law]
    pairs = [pair for c in main for pair in ports[c]]
    accepts = (how.coupling is None or how.coupling.law) and alone and bool(main)
    accepts = accepts and all(port in fmus[plant].inputs for _, port in pairs)
    main = main if accepts else commands
    given = {(c.source.connector, c.target.connector) for c in commands}
    network, acting = bool(len(rest) > 1 or own), {c.source for c in commands}
    others = [SystemPort(e, n) for e, fmu in rest.items() for n in plain_outputs(fmu)]
    signals = [(c.source.connector if alone else str(c.source), taken(c)) for c in measured]
    acted = [(theirs(c.source), c.target.connector if alone else str(c.source)) for c in main]
    fed = {taken(c): order for c, order in goal}
    joint = tuple(acted), tuple(dict.fromkeys(signals)), tuple(fed)
    reports = accepts and plain and all(pair in given for pair in pairs)
    seen = tuple(theirs(port) for port in others if network or port not in acting)
    wiring = Wiring(*joint, accepts, reports, tuple(fed.values()), seen, network)
    return (side, controller), wiring, tuple(main)


def _grouped(
    name: str, members: Mapping[str, Instance], inside: Connections, outside: Connections
) -> Group:
    """Elements as one instance; the sources of the connections from outside are its inputs."""
    feeds, scales = [], dict[str, dict[str, tuple[float, float]]]()
    for c in (*inside, *outside):
        feeds.append(Feed(str(c.source), c.target.element, c.target.connector))
        scales.setdefault(c.target.element, {})[c.target.connector] = c.factor, c.offset
    scaled = {member: converted(fmu, scales.get(member, {})) for member, fmu in members.items()}
    return Group(name, scaled, feeds, list(dict.fromkeys(str(c.source) for c in outside)))


def _law(command: SystemConnection, measured: Connections) -> list[tuple[str, str]]:
    """The law's ports of a command, on the controller's side and on the plant's."""
    source, target = command.source.connector, command.target.connector
    pairs = [(rate_port(source), rate_port(target))]
    for c in measured:
        for port in (gain_port, reference_port):
            pairs.append((port(source, c.target.connector), port(target, c.source.connector)))
    return pairs


def _free_inputs(
    system: SystemStructure, fmus: Fmus, values: Values, main: str, goal: Goal, measured: bool
) -> Iterator[str]:
    """Notes on inputs that nothing drives; FmuError if nothing is measured of the plant, too."""
    driven = {c.target for c in (*system.connections, *(c for c, _ in goal))}
    driven |= {c.target for i in system.inputs for c in i.drives}
    fed = {main, *(c.target.element for c in system.connections)}
    for element, fmu in fmus.items():
        known = {*values[element], *law_ports(fmu.inputs, fmu.inputs, fmu.outputs)}
        ports = (SystemPort(element, n) for n in fmu.inputs if n not in known)
        for port in (p for p in ports if p not in driven):
            if element not in fed and not measured:
                raise FmuError(
                    f"{system.path}: nothing is connected to the input {port}, and no element has "
                    f"an output of {main!r} as its input; expected a closed loop"
                )
            yield free_input(port.connector, element, fmu)
