"""Run a closed loop of an .ssp file of any origin."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..fmus.ports import law_ports
from ..fmus.system_reading import (
    BadSystem,
    SystemConnection,
    SystemPort,
    SystemStructure,
    read_system,
)
from ..solver.nearest import nearest
from .closed_loop import LIMIT, amplifier_notes, fixed_step_notes, limited, own_step, run_by_steps
from .closed_loop_result import ClosedLoopResult
from .converted import AS_IS, Scale, converted
from .couplings import Coupling
from .fmu_instance import SAMPLE_TIME, Instance, Value
from .group import Feed, Group
from .isolated import open_fmu
from .limits import FIRST_STEP, BadParameter, check_step
from .loop import STOP, SystemLoop
from .loop_run import LoopRun
from .master import Progress, run_loop
from .metrics import coarse_notes
from .parts import as_taken, check_names, settable_of
from .port_units import scale_of_results
from .reference_signal import Reference
from .state_trial import check_state
from .system_goal import Fmus, Goal, goal_of
from .system_law import accepts_law, commands_of, reports_law
from .wiring import CONTROLLER, POSITION, Wiring, plain_outputs

Vector = npt.NDArray[np.float64]


def run_system(asked: SystemLoop, progress: Progress | None = None) -> ClosedLoopResult:
    """Run an .ssp: one of its elements is the plant, the others are its controller.

    The plant is the element with feedback-law inputs, else the one called ``plant``, else the one
    whose outputs do not follow its inputs at once and that is not sampled, else the first.

    Raises
    ------
    BadSystem, FmuError, CouplingError, WiringError, BadParameter
        If the file or the request is invalid; the message says why.
    StepFailed
        If a part rejects its initial values.
    """
    system = read_system(asked.system)
    with contextlib.ExitStack() as opened:
        opened.callback(system.remove)
        if system.start != 0.0:
            raise BadSystem(f"{system.path}: starts at t = {system.start:g} s, expected 0")
        stop = asked.stop or system.stop or STOP
        if asked.step is not None:
            check_step("step", asked.step, stop)
        fmus = {}
        for element in system.elements:
            fmus[element.name] = open_fmu(
                element.fmu, element.name, asked.isolate, asked.time_limit
            )
            opened.callback(fmus[element.name].close)
        values = _values(system, asked, fmus)
        own = own_step({f.path.name: f.description for f in fmus.values()})
        first = asked.step or own or min(FIRST_STEP, stop)
        states = [check_state(f, values[name], stop, first) for name, f in fmus.items()]
        loop = _loop(system, fmus, asked)
        free = _free_inputs(system, loop, values)
        reference = asked.reference or Reference.constant(loop.set_point(system, values, fmus))

        sides = [loop.plant, loop.controller]  # for the first run; later runs open their own

        def run_at(step: float, look_again: bool = True) -> LoopRun:
            if not sides:
                for side in (loop.plant.reopened(), loop.controller.reopened()):
                    opened.callback(side.close)
                    sides.append(side)
            plant, controller = sides
            sides.clear()
            return run_loop(
                plant,
                controller,
                reference,
                stop,
                step,
                coupling=asked.coupling,
                corrections=asked.corrections,
                adaptive=asked.adaptive,
                plant_values=_of_side(loop.plant, [loop.plant_name], values),
                controller_values=_of_side(
                    loop.controller, [n for n in fmus if n != loop.plant_name], values
                ),
                mapping=loop.names,
                wiring=loop.wiring,
                progress=progress,
                look_again=look_again,
            )

        run, choice = run_by_steps(asked, run_at, own, stop)
        run = loop.in_units(run)
        limit = f"--set {loop.plant_name}.{LIMIT}="
        of_plant = {n: v for n, v in values[loop.plant_name].items() if not isinstance(v, str)}
        amplifier = amplifier_notes(run, fmus[loop.plant_name].parameters, of_plant, limit)
        amplifier += coarse_notes(run, reference)
        run = limited(run, of_plant)
    notes = [f"{name} is unknown in the system and was ignored" for name in system.ignored]
    notes += [
        f"nothing is connected to the input {port.connector!r} of {port.element}: it stays at "
        f"{start:g}; --set {port}=VALUE gives it a value"
        for port, start in free.items()
    ]
    fixed = fixed_step_notes(first, *fmus.values()) if own or choice is None else ()
    found = [note for state in states for note in state]
    found += [note for fmu in fmus.values() for note in fmu.notes]
    notes += reference.notes(stop)
    return ClosedLoopResult(asked, run, (*notes, *found, *fixed, *amplifier), choice)


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
    system: SystemStructure, loop: _Loop, values: Mapping[str, Mapping[str, Value]]
) -> dict[SystemPort, float]:
    """Inputs that nothing drives and that are given no value, with their start values.

    Raises BadSystem if nothing measures the plant and an element gets nothing from others.
    """
    driven = {c.target for c in (*system.connections, *(c for c, _ in loop.goal))}
    driven |= {c.target for i in system.inputs for c in i.drives}
    found: dict[SystemPort, float] = {}
    for element, fmu in loop.fmus.items():
        law = law_ports(fmu.inputs, fmu.inputs, fmu.outputs)
        for name in fmu.inputs:
            port = SystemPort(element, name)
            if port not in driven and name not in law and name not in values[element]:
                found[port] = fmu.description.by_name[name].start or 0.0
    fed = {loop.plant_name, *(c.target.element for c in system.connections)}
    blind = [port for port in found if port.element not in fed]
    if blind and not loop.wiring.signals:
        raise BadSystem(
            f"{system.path}: nothing is connected to the input {blind[0]}, and no element has an "
            f"output of {loop.plant_name!r} as its input; expected a closed loop"
        )
    return found


def _of_side(
    side: Instance, elements: Sequence[str], values: Mapping[str, Mapping[str, Value]]
) -> dict[str, Value]:
    if isinstance(side, Group):
        return {f"{e}.{name}": v for e in elements for name, v in values[e].items()}
    return dict(values[elements[0]])


@dataclass(frozen=True)
class _Loop:
    """A system cut into a plant and the rest.

    Attributes
    ----------
    names : dict of str to str
        Names of the plant's ports in the results.
    goal : tuple of (SystemConnection, int)
        Connections from the set-point in SI units, and the order of its time derivative for each.
    commands : tuple of SystemConnection
        Connections into the plant, without those of a law that the master applies.
    """

    plant_name: str
    plant: Instance
    controller: Instance
    wiring: Wiring
    names: dict[str, str]
    goal: Goal
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
            others=self._others(run),
            residual_max=residual,
            reference=factor * run.reference + offset,
            scale=(factor, offset),
            units={n: units[n] for n in (*run.outputs, *run.commands)},
        )

    def _others(self, run: LoopRun) -> dict[str, Vector]:
        """The other outputs, as ``element.NAME``."""
        named = self._given(run)
        commands = {str(c.source) for c in self.commands}
        return {name: v for name, v in named.items() if name not in commands}

    def _given(self, run: LoopRun) -> dict[str, Vector]:
        """All recorded outputs of the elements except the plant, as ``element.NAME``."""
        own = next(e for e in self.fmus if e != self.plant_name)
        by = "" if isinstance(self.controller, Group) else f"{own}."
        return {by + name.removeprefix(f"{CONTROLLER}."): v for name, v in run.others.items()}

    def set_point(
        self, system: SystemStructure, values: Mapping[str, Mapping[str, Value]], fmus: Fmus
    ) -> float:
        """The set-point's start value in SI units; NaN if there is no set-point."""
        if not self.goal:
            return math.nan
        goal, _ = self.goal[0]
        target = goal.target
        given = values[target.element].get(target.connector)
        if given is None:
            variables = fmus[target.element].description.variables
            given = next(v.start for v in variables if v.name == target.connector) or 0.0
        return (float(given) - goal.offset) / (goal.factor or math.nan)


def _loop(system: SystemStructure, fmus: Fmus, asked: SystemLoop) -> _Loop:
    if len(fmus) < 2:
        raise BadSystem(f"{system.path}: has one element; a closed loop has two or more")
    plant = _plant(fmus)
    rest = [n for n in fmus if n != plant]
    goal = goal_of(system, fmus, rest)
    if asked.reference and not goal:
        raise BadSystem(f"{system.path}: has no input for a set-point; set start values instead")
    inside = [c for c in system.connections if plant not in (c.source.element, c.target.element)]
    measured = [c for c in system.connections if c.source.element == plant != c.target.element]
    commands = [c for c in system.connections if c.target.element == plant != c.source.element]
    own = [c for c in system.connections if plant == c.source.element == c.target.element]
    if not commands:
        raise BadSystem(f"{system.path}: nothing drives {plant!r}, so it is used as the plant")

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
    law = asked.coupling in (None, Coupling.INTERFACE_JACOBIAN) and alone
    main = commands_of(commands, measured) if law else commands
    accepts = law and accepts_law(fmus[plant], main, measured)
    if not accepts:
        main = commands
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
        reports_law=accepts and plain and reports_law(main, measured, commands),
        others=tuple(map(theirs, others)),
        network=network,
    )
    names = {f"{plant}.{port}": port for port in fmus[plant].outputs}
    names |= {str(c.source): c.target.connector for c in main} if not alone else {}
    return _Loop(plant, side, controller, wiring, names, goal, tuple(main), fmus)


def _plant(fmus: Fmus) -> str:
    def rank(name: str) -> tuple[bool, bool, bool]:
        fmu = fmus[name]
        law = bool(law_ports(fmu.inputs, fmu.inputs, fmu.outputs))
        silent = bool(fmu.outputs) and not any(fmu.follows_at_once(y) for y in fmu.outputs)
        return law, name == "plant", silent and SAMPLE_TIME not in fmu.parameters

    return max(fmus, key=rank)  # the first of equals


def _plain(connections: Sequence[SystemConnection], once: bool) -> bool:
    """Whether no connection is scaled; with `once`, also no source drives two ports."""
    joined = all(c.factor == 1.0 and c.offset == 0.0 for c in connections)
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
