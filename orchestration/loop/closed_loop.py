"""Run a closed loop: a pair of parts, or the elements of an .ssp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial

from ...fmus.ports import reference_port
from ...solver.errors import CouplingError
from ...solver.set_point import SET_POINT
from ..fmu.isolated import open_fmu
from ..fmu.limits import FIRST_STEP
from ..fmu.port_units import PortUnits, convert
from ..fmu.sampled_fmu import sampled_every
from ..fmu.sampling import answers_in_steps
from ..fmu.wiring import CONTROLLER, PLANT, Wiring, names_on, wire, with_aliases
from ..master.couplings import Coupling
from ..master.loop_run import LoopRun
from ..master.master import Progress
from .catalogue import NAMES
from .closed_loop_result import ClosedLoopResult
from .joined import Fmu, Joined, amplifier_notes, limited, own_step
from .loop import Loop, SystemLoop
from .parts import Part, as_taken, check_names, settable_of
from .system import joined_system
from .whole_loop import run_monolithic

_LIMIT_OPTION = "--limit-voltage "


def run_closed_loop(loop: Loop | SystemLoop, progress: Progress | None = None) -> ClosedLoopResult:
    """Run a closed loop, with a verdict on its coupling.

    Raises
    ------
    FmuError, CouplingError, BadParameter
        If the loop cannot be run; the message says why.
    StepFailed
        If a part rejects its initial values.
    """
    if isinstance(loop, SystemLoop):
        with joined_system(loop) as joined:
            run, choice, notes = joined.run(loop, progress)
        return ClosedLoopResult(loop, run, notes, choice)
    if loop.coupling is Coupling.MONOLITHIC:
        run = limited(_run_monolithic(loop, progress), loop.plant_values)
        found = amplifier_notes(run, loop.plant.parameters, _LIMIT_OPTION)
        return ClosedLoopResult(loop, run, (*loop.notes, *found))
    loop = _sampled_if_it_answers_in_steps(loop)
    with joined_pair(loop) as joined:
        run, choice, notes = joined.run(loop, progress)
    if not run.verdict.trusted and not loop.controller.has_equations and not run.sampling_period:
        notes += (f"if {loop.label} is a digital controller, give its period with --sampled",)
    return ClosedLoopResult(loop, run, notes, choice)


@contextmanager
def joined_pair(loop: Loop) -> Iterator[Joined]:
    """Both FMUs of a loop, joined; closed at the end.

    Raises `FmuError`, `CouplingError`, `BadParameter` if they cannot be joined.
    """
    with closing(_opened(loop, PLANT)) as plant, closing(_opened(loop, CONTROLLER)) as own:
        sampled = {CONTROLLER: loop.sampled} if loop.sampled else {}
        controller = sampled_every(own, loop.sampled) if loop.sampled else own
        for fmu, given in ((plant, loop.plant_values), (controller, loop.controller_values)):
            check_names(fmu.name, given, settable_of(fmu.description))
        of_plant = as_taken(plant.name, plant.description, loop.plant_values)
        of_controller = as_taken(controller.name, controller.description, loop.controller_values)
        mapping = with_aliases(plant, controller, loop.mapping)
        wiring = wire(plant, controller, mapping)
        wiring.check_given(of_plant, of_controller)
        converted, units = convert(plant, controller, wiring, mapping)
        notes = _connection_notes(loop, mapping, plant, converted, wiring)
        yield Joined(
            fmus={PLANT: plant, CONTROLLER: controller},
            values={PLANT: of_plant, CONTROLLER: of_controller},
            main=PLANT,
            sides=(plant, converted),
            side_values=(of_plant, of_controller),
            wiring=wiring,
            names=mapping,
            reference=loop.reference,
            stop=loop.stop,
            finish=partial(_in_units, plant=plant, mapping=mapping, units=units),
            notes=(*loop.notes, *notes, *units.notes),
            limit_option=_LIMIT_OPTION,
            sampled=sampled,
            may_try=True,
        )


def _opened(loop: Loop, side: str) -> Fmu:
    part = loop.plant if side == PLANT else loop.controller
    return open_fmu(part.fmu(), side, loop.isolate, loop.time_limit)


def _sampled_if_it_answers_in_steps(loop: Loop) -> Loop:
    """The loop; if its controller computes outputs in its steps only, a digital one."""
    part, values = loop.controller, loop.controller_values
    if loop.sampled or part.has_equations or part.is_none:
        return loop
    fmu, try_out = part.description, partial(_opened, loop, CONTROLLER)
    step = loop.step or own_step({part.name: fmu}) or min(FIRST_STEP, loop.stop)
    if not answers_in_steps(fmu, try_out, values, loop.stop, step):
        return loop
    note = (
        f"{loop.label} computes its outputs in its steps only: it is run as a digital controller "
        f"with the communication step of {step:g} s as its period; --sampled gives another"
    )
    return replace(loop, sampled=step, notes=(*loop.notes, note))


def _in_units(run: LoopRun, plant: Fmu, mapping: Mapping[str, str], units: PortUnits) -> LoopRun:
    """The run with the set-point in the plant's unit, and with all units."""
    known = {v.name: v.unit for v in plant.description.variables} | dict(units.commands)
    ours = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    recorded = {**run.outputs, **run.commands}
    told = {ours[n]: known[n] for n in ours if ours[n] in recorded}
    factor, offset = units.set_point
    reference = factor * run.reference + offset
    return replace(run, units=told, reference=reference, scale=units.set_point)


def _connection_notes(
    loop: Loop, mapping: Mapping[str, str], plant: Fmu, controller: Fmu, wiring: Wiring
) -> tuple[str, ...]:
    """Notes on inputs that are not connected, and on the input used for the set-point."""
    notes = []
    acts = [name for name in wiring.unconnected if _acts(loop.controller, name)]
    for side, label, free, values in (
        (plant, loop.plant.label, wiring.of_plant, loop.plant_values),
        (controller, loop.label, acts, loop.controller_values),
    ):
        starts = {v.name: v.start or 0.0 for v in side.description.variables}
        notes += [
            f"nothing is connected to the input {name!r} of {label}: it stays at {starts[name]:g}; "
            f"--map {name}=NAME connects it, --set {side.name}.{name}=VALUE gives it a value"
            for name in free
            if name not in values
        ]
    called = names_on(CONTROLLER, wiring.references, mapping)
    notes += [
        f"the input {name!r} of {loop.label}, which is not connected, is used "
        f"as the set-point {SET_POINT}"
        for name, order in zip(wiring.references, wiring.orders, strict=True)
        if order == 0 and called[name] != SET_POINT
    ]
    return tuple(notes)


def _acts(controller: Part, name: str) -> bool:
    """Whether an input of a controller has an effect beyond the reported law."""
    if not controller.has_equations or controller.kernel.discrete:
        return True
    reported = reference_port("", name)
    outputs = controller.kernel.outputs
    return any(name in o.uses for o in outputs if not o.name.endswith(reported))


def _run_monolithic(loop: Loop, progress: Progress | None) -> LoopRun:
    for part in (loop.plant, loop.controller):
        if not part.has_equations:
            raise CouplingError(
                f"the monolithic coupling needs the equations of {part}, and an FMU has "
                f"none; expected one of {', '.join(NAMES)}, and FILE.py:FUNCTION"
            )
    if loop.adaptive or loop.corrections or loop.mapping:
        raise CouplingError(
            "the monolithic coupling has no communication steps or ports; remove "
            "options for steps, corrections and --map"
        )
    loop.check_values()
    return run_monolithic(loop, loop.step or min(FIRST_STEP, loop.stop), progress)
