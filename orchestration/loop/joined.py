"""Both sides of a closed loop, open and joined: what a pair of parts and an .ssp both become."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from ...fmus.ports import law_ports, reference_port
from ...fmus.reading import Description
from ...fmus.system_network import SystemConnection, SystemPort
from ...plant.instruments import LIMIT, UNLIMITED
from ...solver.errors import CouplingError
from ...solver.signals import SET_POINT
from ..fmu.fmu_instance import FmuInstance, Instance, Value
from ..fmu.group import Group
from ..fmu.isolated import IsolatedInstance, open_fmu
from ..fmu.limits import FIRST_STEP
from ..fmu.trials import Sampled, answers_in_steps, check_state
from ..fmu.wiring import AS_IS, CONTROLLER, PLANT, Wiring, convert, names_on, wire, with_aliases
from ..master.march import LoopRun, Progress
from ..master.master import MOST, MOST_OF_ISOLATED, StepChoice, choose_step, only_step, run_loop
from ..master.reference_signal import Reference
from ..master.runs import Runs
from ..master.sides import Sides
from .loop import HowCoupled, Loop
from .parts import Part, taken

Fmu = FmuInstance | IsolatedInstance
Values = Mapping[str, Value]

COARSE = 0.05  # of the largest error: more between two points is noted
WITHIN = 8  # parts of a step, in which the set-point is looked at


@dataclass(frozen=True)
class Joined:
    """Both sides of a loop, not initialized, and what runs of them need."""

    how: HowCoupled
    fmus: Mapping[str, Fmu]  # all of them, by name
    values: Mapping[str, Values]  # of each of them
    main: str  # the plant among them
    sides: tuple[Instance, Instance]  # plant and controller, alone or within a group
    wiring: Wiring
    names: Mapping[str, str]  # of ports, in the results
    commands: tuple[SystemConnection, ...]  # into the plant, without those of the law
    scale: tuple[float, float]  # from the set-point's SI unit to that of the plant's position
    reference: Reference
    stop: float  # [s]
    notes: tuple[str, ...]
    sampled: Mapping[str, float] = field(default_factory=dict)  # periods of digital FMUs [s]

    def run_at(self, step: float) -> LoopRun:
        """Run both sides once, with this step [s], without a verdict."""
        self._check_states(step)
        return self._finished(run_loop(self._coupled(), step, look=False))

    def run(self, progress: Progress) -> tuple[LoopRun, StepChoice | None, tuple[str, ...]]:
        """Run with the requested step, else that of the FMUs, else as by `choose_step`."""
        how, choice = self.how, None
        stepped = [f for n, f in self.fmus.items() if n not in self.sampled]
        own = 0.0 if how.step else _own_step({f.path.name: f.description for f in stepped})
        step = how.step or own or min(FIRST_STEP, self.stop)
        states, sides = self._check_states(step), self._coupled()
        if how.step is None and not own:
            # a call of an FMU in its own process takes much longer
            slow = any(isinstance(f, IsolatedInstance) for f in self.fmus.values())
            most = MOST_OF_ISOLATED if slow else MOST
            run, choice = choose_step(Runs(sides, step, progress), most)
        else:
            run = run_loop(sides, step, progress=progress)
            if own:
                run, choice = only_step(run, own)
        run, step = self._finished(run), choice.step if choice else step
        return run, choice, (*self.notes, *states, *self._notes_on(run, step))

    def _coupled(self) -> Sides:
        """Both sides, as the master runs them."""
        others = [n for n in self.fmus if n != self.main]
        values = self._of_side(0, [self.main]), self._of_side(1, others)
        asked = *self.sides, self.reference, self.stop, self.how.coupling, self.how.corrections
        return Sides(*asked, values, self.names, self.wiring)

    def _of_side(self, side: int, names: list[str]) -> Values:
        if isinstance(self.sides[side], Group):
            return {f"{e}.{name}": v for e in names for name, v in self.values[e].items()}
        return self.values[names[0]]

    def _check_states(self, step: float) -> list[str]:
        items = self.fmus.items()
        return [t for n, f in items for t in check_state(f, self.values[n], self.stop, step)]

    def _finished(self, run: LoopRun) -> LoopRun:
        """The run with commands and set-point in the plant's units, all units, and its limit."""
        plant = self.fmus[self.main]
        called = names_on(PLANT, [*plant.outputs, *plant.inputs], self.names)
        known = {v.name: v.unit for v in plant.description.variables}
        units = {name: known[n] for n, name in called.items()}
        commands, residual = dict(run.commands), dict(run.residual_max)
        own = next(n for n in self.fmus if n != self.main)
        by = "" if isinstance(self.sides[1], Group) else f"{own}."
        given = {by + n.removeprefix(f"{CONTROLLER}."): v for n, v in run.others.items()}
        for c in self.commands:
            name, source = called[c.target.connector], str(c.source)
            fmu = self.fmus[c.source.element]
            if source in given and not fmu.sample_time:
                # the recorded commands of a sampled group are those of the end of the next step
                commands[name] = given[source]
            if isinstance(self.sides[0], Group):
                commands[name] = c.factor * commands[name] + c.offset
                residual[name] *= abs(c.factor)
            if not units[name] and as_is(c):
                units[name] = fmu.description.by_name[c.source.connector].unit
        acting, (factor, offset) = {str(c.source) for c in self.commands}, self.scale
        units = {n: units[n] for n in (*run.outputs, *run.commands)}
        others = {n: y for n, y in given.items() if n not in acting}
        goal = factor * run.reference + offset
        run = replace(run, reference=goal, scale=self.scale, units=units, others=others)
        run = replace(run, commands=commands, residual_max=residual)
        return limited(run, self.values[self.main])

    def _notes_on(self, run: LoopRun, step: float) -> Iterator[str]:
        for name, fmu in self.fmus.items():
            asked, size = self.sampled.get(name, step), fmu.description.step_size
            if not fmu.description.steps_vary and size != asked:
                yield (
                    f"{fmu.path.stem} requires steps "
                    f"{f'of {size:g} s' if size else 'of constant length'}; this run and its "
                    "checks use other steps, so do not rely on the verdict alone"
                )
        yield from (note for fmu in self.fmus.values() for note in fmu.notes)
        yield from _coarse_notes(run, self.reference)


def _own_step(fmus: Mapping[str, Description]) -> float:
    """The step of FMUs with fixed steps [s]; 0 if there are none; `CouplingError` for two steps."""
    sizes = {n: a.step_size for n, a in fmus.items() if not a.steps_vary and a.step_size}
    if len(set(sizes.values())) > 1:
        each = " and ".join(f"{name} of {size:g} s" for name, size in sizes.items())
        raise CouplingError(f"no common step exists: {each} allow only this step")
    return next(iter(sizes.values()), 0.0)


def limited(run: LoopRun, values: Values) -> LoopRun:
    """The run with the limit of its plant, from the plant's values."""
    limit = values.get(LIMIT, UNLIMITED)
    return run if isinstance(limit, str) else replace(run, limit=limit)


def _coarse_notes(run: LoopRun, reference: Reference) -> Iterator[str]:
    """A note if the error may be larger between communication points than at them."""
    if run.between or run.alone or run.stopped or "x" not in run.outputs or len(run.time) < 3:
        return
    time, x, goal = run.time, run.outputs["x"], run.reference
    within = time[:-1] + np.linspace(0.0, 1.0, WITHIN + 1)[:, None] * np.diff(time)
    factor, offset = run.scale
    inside = factor * reference.on(within.ravel(), 0).reshape(within.shape) + offset
    above = inside - np.maximum(goal[:-1], goal[1:])
    below = np.minimum(goal[:-1], goal[1:]) - inside
    most = max(above.max(), below.max(), np.abs(np.diff(x, 2)).max() / 8)  # the last: a parabola
    if most > COARSE * np.abs(goal - x).max():
        yield (
            f"steps of {np.diff(time).max():g} s are coarse for the figures, which count "
            f"communication points only: between them the error may move by {most:.2g} more; use a "
            "smaller communication step"
        )


def join_pair(loop: Loop, opening: Callable[[Path, str], Fmu]) -> Joined:
    """Both FMUs of a loop, joined; `CouplingError`, `BadParameter` if they cannot be."""
    plant = opening(loop.plant.fmu(), PLANT)
    own = opening(loop.controller.fmu(), CONTROLLER)
    controller = cast("Fmu", Sampled(own, loop.sampled)) if loop.sampled else own
    values = {
        PLANT: taken(PLANT, plant.description, loop.plant_values),
        CONTROLLER: taken(CONTROLLER, own.description, loop.controller_values),
    }
    mapping = with_aliases(plant, controller, loop.mapping)
    wiring = wire(plant, controller, mapping)
    wiring.check_given(values)
    converted, scale, of_units = convert(plant, controller, wiring, mapping)
    ports = ((SystemPort(CONTROLLER, u), SystemPort(PLANT, n)) for u, n in wiring.commands)
    commands = tuple(SystemConnection(*both) for both in ports)
    fmus, sides = {PLANT: plant, CONTROLLER: controller}, (plant, converted)
    notes = (*loop.notes, *_connection_notes(loop, fmus, wiring, mapping), *of_units)
    joint = wiring, mapping, commands, scale, loop.reference, loop.stop, notes
    sampled = {CONTROLLER: loop.sampled} if loop.sampled else {}
    return Joined(loop, fmus, values, PLANT, sides, *joint, sampled)


def as_it_answers(loop: Loop) -> Loop:
    """The loop; if its controller computes outputs in its steps only, a digital one."""
    part, values = loop.controller, loop.controller_values
    if loop.sampled or part.has_equations or part.is_none:
        return loop
    step = loop.step or _own_step({part.name: part.description}) or min(FIRST_STEP, loop.stop)
    try_out = partial(open_fmu, part.fmu(), CONTROLLER, loop.isolate, loop.time_limit)
    if not answers_in_steps(part.description, try_out, values, loop.stop, step):
        return loop
    note = (
        f"{loop.label} computes its outputs in its steps only: it is run as a digital controller "
        f"with the communication step of {step:g} s as its period; give its sampling period if it "
        "has another"
    )
    return replace(loop, sampled=step, notes=(*loop.notes, note))


def as_is(*connections: SystemConnection) -> bool:
    """Whether no connection is scaled."""
    return all((c.factor, c.offset) == AS_IS for c in connections)


def free_input(name: str, label: str, fmu: Fmu) -> str:
    """A note on an input that nothing is connected to."""
    start = fmu.description.by_name[name].start or 0.0
    said = f"it stays at {start:g}; connect it, or give it a value"
    return f"nothing is connected to the input {name!r} of {label}: {said}"


def _connection_notes(
    loop: Loop, fmus: Mapping[str, Fmu], wiring: Wiring, mapping: Mapping[str, str]
) -> Iterator[str]:
    """Notes on inputs that are not connected, and on the input used for the set-point."""
    plant, own = fmus.values()
    law, driven = law_ports(plant.inputs, plant.inputs, plant.outputs), wiring.driven
    known = {*driven[PLANT], *law, *loop.plant_values}
    free = (n for n in plant.inputs if n not in known)
    yield from (free_input(n, loop.plant.label, plant) for n in free)
    known = {*driven[CONTROLLER], *loop.controller_values}
    free = (n for n in own.inputs if n not in known and _acts(loop.controller, n))
    yield from (free_input(n, loop.label, own) for n in free)
    called = names_on(CONTROLLER, wiring.references, mapping)
    for name, order in zip(wiring.references, wiring.orders, strict=True):
        if order == 0 and called[name] != SET_POINT:
            yield (
                f"the input {name!r} of {loop.label}, which is not connected, is used "
                f"as the set-point {SET_POINT}"
            )


def _acts(controller: Part, name: str) -> bool:
    """Whether an input of a controller has an effect beyond the reported law."""
    if not controller.has_equations or controller.kernel.discrete:
        return True
    reported = reference_port("", name)
    outputs = controller.kernel.outputs
    return any(name in o.uses for o in outputs if not o.name.endswith(reported))
