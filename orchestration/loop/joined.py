"""Both sides of a closed loop, open and joined: what a pair of parts and an .ssp both become."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...fmus.ports import reference_port
from ...fmus.reading import Description
from ...plant.instruments import NOMINAL_VOLTAGE, UNLIMITED
from ...solver.errors import CouplingError
from ...solver.signals import SET_POINT
from ..fmu.fmu_instance import FmuInstance, Instance, Value
from ..fmu.group import Group
from ..fmu.isolated import IsolatedInstance, open_fmu
from ..fmu.limits import FIRST_STEP
from ..fmu.trials import answers_in_steps, check_state, sampled_every
from ..fmu.wiring import (
    CONTROLLER,
    PLANT,
    PortUnits,
    Wiring,
    convert,
    names_on,
    wire,
    with_aliases,
)
from ..master.march import LoopRun
from ..master.master import (
    MOST,
    MOST_OF_ISOLATED,
    StepChoice,
    choose_step,
    only_step,
    run_loop,
)
from ..master.reference_signal import Reference
from ..master.runs import Runs
from ..master.sides import Sides
from .catalogue import AMPLIFIER, LIMIT
from .loop import HowCoupled, Loop
from .parts import Part, taken

Fmu = FmuInstance | IsolatedInstance
Values = Mapping[str, Value]
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Joined:
    """Both sides of a loop, not initialized, and what runs of them need."""

    fmus: Mapping[str, Fmu]  # all of them, by name
    values: Mapping[str, Values]  # of each of them
    main: str  # the plant among them
    sides: tuple[Instance, Instance]  # plant and controller, alone or within a group
    wiring: Wiring
    names: Mapping[str, str]  # of ports, in the results
    reference: Reference
    stop: float  # [s]
    finish: Callable[[LoopRun], LoopRun]  # a run in the units of the results
    notes: tuple[str, ...]
    sampled: Mapping[str, float]  # periods of FMUs that are stepped at their samples only [s]

    def _coupled(self, how: HowCoupled) -> Sides:
        """Both sides, as the master runs them."""
        others = [n for n in self.fmus if n != self.main]
        return Sides(
            *self.sides,
            self.reference,
            self.stop,
            how.coupling,
            how.corrections,
            (self._of_side(0, [self.main]), self._of_side(1, others)),
            self.names,
            self.wiring,
        )

    def run_at(self, how: HowCoupled, step: float, progress: Progress | None = None) -> LoopRun:
        """Run both sides once, with this step [s], without a verdict."""
        self._check_states(step)
        run = run_loop(self._coupled(how), step, progress=progress, look=False)
        return limited(self.finish(run), self.values[self.main])

    def _of_side(self, side: int, names: Sequence[str]) -> Values:
        if isinstance(self.sides[side], Group):
            return {f"{e}.{name}": v for e in names for name, v in self.values[e].items()}
        return self.values[names[0]]

    def run(
        self, how: HowCoupled, progress: Progress | None
    ) -> tuple[LoopRun, StepChoice | None, tuple[str, ...]]:
        """Run with the requested step, else with that of the FMUs, else as by `choose_step`.

        Also returns how the step was chosen, and notes.
        """
        stepped = [f for n, f in self.fmus.items() if n not in self.sampled]
        own = 0.0 if how.step else _own_step({f.path.name: f.description for f in stepped})
        step = how.step or own or min(FIRST_STEP, self.stop)
        states = self._check_states(step)
        sides, choice = self._coupled(how), None
        if how.step is None and not own:
            # a call of an FMU in its own process takes much longer
            slow = any(isinstance(f, IsolatedInstance) for f in self.fmus.values())
            runs = Runs(sides, step, progress)
            run, choice = choose_step(runs, MOST_OF_ISOLATED if slow else MOST)
        else:
            run = run_loop(sides, step, progress=progress)
            if own:
                run, choice = only_step(run, own)
        run = limited(self.finish(run), self.values[self.main])
        step = choice.step if choice else step
        return run, choice, (*self.notes, *states, *self._notes_on(run, step))

    def _check_states(self, step: float) -> list[str]:
        items = self.fmus.items()
        return [t for n, f in items for t in check_state(f, self.values[n], self.stop, step)]

    def _notes_on(self, run: LoopRun, step: float) -> Iterator[str]:
        for name, fmu in self.fmus.items():
            asked, size = self.sampled.get(name, step), fmu.description.step_size
            if not fmu.description.steps_vary and size != asked:
                yield (
                    f"{fmu.path.stem} requires steps "
                    f"{f'of {size:g} s' if size else 'of constant length'}; this run and its "
                    "checks use other steps, so do not rely on the verdict alone"
                )
        for fmu in self.fmus.values():
            yield from fmu.notes
        yield from _coarse_notes(run, self.reference)
        yield from amplifier_notes(run, self.fmus[self.main].parameters)


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


def amplifier_notes(run: LoopRun, parameters: Iterable[str]) -> Iterator[str]:
    """A note if the command exceeds the limit of the nominal amplifier."""
    of_motor = {LIMIT, AMPLIFIER} <= {*parameters} and "u" in run.commands
    # the peak of a diverged loop is meaningless
    if not of_motor or run.limit <= NOMINAL_VOLTAGE or run.stopped:
        return
    peak = float(np.max(np.abs(run.commands["u"])))
    if peak > NOMINAL_VOLTAGE:
        limit = run.limit
        has = "has no limit" if limit >= UNLIMITED else f"is limited to {limit:g} V"
        yield (
            f"the peak of {peak:.4g} V is more than the {NOMINAL_VOLTAGE:g} V of the nominal "
            f"amplifier, and this run {has}; with the plant's {LIMIT} of {NOMINAL_VOLTAGE:g} V the "
            "motor would get no more"
        )


COARSE = 0.05  # of the largest error: more between two points is noted
PARTS = 8  # of a step, in which the set-point is looked at


def _coarse_notes(run: LoopRun, reference: Reference) -> Iterator[str]:
    """A note if the error may be larger between communication points than at them."""
    if run.between or run.alone or run.stopped or "x" not in run.outputs or len(run.time) < 3:
        return
    time, x, goal = run.time, run.outputs["x"], run.reference
    within = time[:-1] + np.linspace(0.0, 1.0, PARTS + 1)[:, None] * np.diff(time)
    factor, offset = run.scale
    inside = factor * reference.on(within.ravel(), 0).reshape(within.shape) + offset
    above = inside - np.maximum(goal[:-1], goal[1:])
    below = np.minimum(goal[:-1], goal[1:]) - inside
    of_parabola = np.abs(np.diff(x, 2)).max() / 8
    most = max(above.max(), below.max(), of_parabola)
    if most > COARSE * np.abs(goal - x).max():
        yield (
            f"steps of {np.diff(time).max():g} s are coarse for the figures, which count "
            f"communication points only: between them the error may move by {most:.2g} more; use a "
            "smaller communication step"
        )


@contextmanager
def joined_pair(loop: Loop) -> Iterator[Joined]:
    """Both FMUs of a loop, joined; closed at the end.

    Raises `FmuError`, `CouplingError`, `BadParameter` if they cannot be joined.
    """
    parts = {PLANT: loop.plant, CONTROLLER: loop.controller}
    fmus = (opened(loop, part.fmu(), side) for side, part in parts.items())
    with closing(next(fmus)) as plant, closing(next(fmus)) as own:
        sampled = {CONTROLLER: loop.sampled} if loop.sampled else {}
        controller = sampled_every(own, loop.sampled) if loop.sampled else own
        values = {
            PLANT: taken(PLANT, plant.description, loop.plant_values),
            CONTROLLER: taken(CONTROLLER, own.description, loop.controller_values),
        }
        mapping = with_aliases(plant, controller, loop.mapping)
        wiring = wire(plant, controller, mapping)
        wiring.check_given(values[PLANT], values[CONTROLLER])
        converted, units = convert(plant, controller, wiring, mapping)
        notes = _connection_notes(loop, mapping, plant, converted, wiring)
        yield Joined(
            fmus={PLANT: plant, CONTROLLER: controller},
            values=values,
            main=PLANT,
            sides=(plant, converted),
            wiring=wiring,
            names=mapping,
            reference=loop.reference,
            stop=loop.stop,
            finish=partial(_in_units, plant=plant, mapping=mapping, units=units),
            notes=(*loop.notes, *notes, *units.notes),
            sampled=sampled,
        )


def opened(how: HowCoupled, path: Path, name: str) -> Fmu:
    """An FMU of a loop."""
    return open_fmu(path, name, how.isolate, how.time_limit)


def as_it_answers(loop: Loop) -> Loop:
    """The loop; if its controller computes outputs in its steps only, a digital one."""
    part, values = loop.controller, loop.controller_values
    if loop.sampled or part.has_equations or part.is_none:
        return loop
    step = loop.step or _own_step({part.name: part.description}) or min(FIRST_STEP, loop.stop)
    try_out = partial(opened, loop, part.fmu(), CONTROLLER)
    if not answers_in_steps(part.description, try_out, values, loop.stop, step):
        return loop
    note = (
        f"{loop.label} computes its outputs in its steps only: it is run as a digital controller "
        f"with the communication step of {step:g} s as its period; give its sampling period if it "
        "has another"
    )
    return replace(loop, sampled=step, notes=(*loop.notes, note))


def _in_units(run: LoopRun, plant: Fmu, mapping: Mapping[str, str], units: PortUnits) -> LoopRun:
    """The run with the set-point in the plant's unit, and with all units."""
    known = {v.name: v.unit for v in plant.description.variables} | dict(units.commands)
    ours = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    recorded = {**run.outputs, **run.commands}
    factor, offset = units.set_point
    return replace(
        run,
        units={ours[n]: known[n] for n in ours if ours[n] in recorded},
        reference=factor * run.reference + offset,
        scale=units.set_point,
    )


def free_input(name: str, label: str, fmu: Fmu) -> str:
    """A note on an input that nothing is connected to."""
    start = fmu.description.by_name[name].start or 0.0
    said = f"it stays at {start:g}; connect it, or give it a value"
    return f"nothing is connected to the input {name!r} of {label}: {said}"


def _connection_notes(
    loop: Loop, mapping: Mapping[str, str], plant: Fmu, controller: Fmu, wiring: Wiring
) -> Iterator[str]:
    """Notes on inputs that are not connected, and on the input used for the set-point."""
    acts = [name for name in wiring.unconnected if _acts(loop.controller, name)]
    for side, label, free, values in (
        (plant, loop.plant.label, wiring.of_plant, loop.plant_values),
        (controller, loop.label, acts, loop.controller_values),
    ):
        yield from (free_input(name, label, side) for name in free if name not in values)
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
