"""Closed-loop runs of two parts, by name or by file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ..fmus.ports import reference_port
from ..fmus.reading import Description
from ..instruments import NOMINAL_VOLTAGE, UNLIMITED
from ..solver.set_point import SET_POINT
from .catalogue import NAMES
from .closed_loop_result import ClosedLoopResult
from .couplings import Coupling
from .fmu_instance import FmuInstance
from .isolated import IsolatedInstance, open_fmu
from .limits import FIRST_STEP
from .loop import HowCoupled, Loop
from .loop_run import CouplingError, LoopRun
from .master import Progress, run_loop
from .metrics import coarse_notes
from .parts import Part, as_taken, check_names, settable_of
from .port_units import convert
from .sampled_fmu import sampled_every
from .sampling import answers_in_steps
from .state_trial import check_state
from .step_choice import StepChoice, choose_step, only_step
from .whole_loop import run_monolithic
from .wiring import CONTROLLER, PLANT, Wiring, names_on, wire, with_aliases

LIMIT, CURRENT_LIMIT = "voltage_limit", "current_limit"  # parameters of a plant with a motor
_Fmu = FmuInstance | IsolatedInstance
_RunAt = Callable[[float, bool], LoopRun]


def run_pair(loop: Loop, progress: Progress | None = None) -> ClosedLoopResult:
    """Run a closed loop of two parts, with a verdict on its coupling.

    Raises
    ------
    FmuError, WiringError, CouplingError, BadParameter
        If the loop cannot be run; the message says why.
    StepFailed
        If a part rejects its initial values.
    """
    if loop.coupling is Coupling.MONOLITHIC:
        run = limited(_run_monolithic(loop, progress), loop.plant_values)
        found = amplifier_notes(run, loop.plant.parameters, loop.plant_values, "--limit-voltage ")
        return ClosedLoopResult(loop, run, (*loop.notes, *found))
    notes: tuple[str, ...] = ()
    loop = _sampled_if_it_answers_in_steps(loop)

    def run_at(step: float, look_again: bool, tries: bool = False) -> LoopRun:
        nonlocal notes
        with opened(loop) as (plant, controller):
            run, found = run_parts(loop, plant, controller, step, progress, look_again, tries)
        notes = *loop.notes, *found
        return run

    stepped = [loop.plant, *([] if loop.sampled else [loop.controller])]
    files = [] if loop.step else [p for p in stepped if not p.has_equations]
    own = own_step({p.name: p.description for p in files})
    run, choice = run_by_steps(loop, run_at, own, loop.stop, partial(run_at, tries=True))
    if not run.verdict.trusted and not loop.controller.has_equations and not run.sampling_period:
        notes += (f"if {loop.label} is a digital controller, give its period with --sampled",)
    return ClosedLoopResult(loop, run, notes, choice)


@contextmanager
def opened(loop: Loop) -> Iterator[tuple[_Fmu, _Fmu]]:
    """Both FMUs of a loop, not initialized, and closed at the end."""
    with closing(_opened(loop, PLANT)) as plant, closing(_opened(loop, CONTROLLER)) as controller:
        yield plant, sampled_every(controller, loop.sampled) if loop.sampled else controller


def _opened(loop: Loop, side: str) -> _Fmu:
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


def run_by_steps(
    loop: HowCoupled,
    run_at: _RunAt,
    own: float,
    stop: float,
    try_at: _RunAt | None = None,
) -> tuple[LoopRun, StepChoice | None]:
    """Run with the requested step, else with that of the FMUs [s], else as by `choose_step`."""
    first = min(FIRST_STEP, stop)
    if loop.step is not None or loop.adaptive:
        return run_at(loop.step or own or first, True), None
    if own:
        return only_step(run_at(own, True), own)
    return choose_step(run_at, first, try_at)


def own_step(fmus: Mapping[str, Description]) -> float:
    """The step of FMUs with fixed steps [s]; 0 if there are none.

    Raises
    ------
    CouplingError
        If two of them have different steps.
    """
    sizes = {n: a.step_size for n, a in fmus.items() if not a.steps_vary and a.step_size}
    if len(set(sizes.values())) > 1:
        told = " and ".join(f"{Path(n).name} of {size:g} s" for n, size in sizes.items())
        raise CouplingError(f"no common step exists: {told} allow only this step")
    return next(iter(sizes.values()), 0.0)


def run_parts(
    loop: Loop,
    plant: _Fmu,
    controller: _Fmu,
    step: float,
    progress: Progress | None = None,
    look_again: bool = True,
    tries: bool = False,
) -> tuple[LoopRun, tuple[str, ...]]:
    """Run open parts that are not initialized with this step [s]; also notes on the run."""
    for fmu, given in ((plant, loop.plant_values), (controller, loop.controller_values)):
        check_names(fmu.name, given, settable_of(fmu.description))
    of_plant = as_taken(plant.name, plant.description, loop.plant_values)
    of_controller = as_taken(controller.name, controller.description, loop.controller_values)
    mapping = with_aliases(plant, controller, loop.mapping)
    wiring = wire(plant, controller, mapping)
    wiring.check_given(of_plant, of_controller)
    states = check_state(plant, of_plant, loop.stop, step)
    states += check_state(controller, of_controller, loop.stop, step)
    controller, units = convert(plant, controller, wiring, mapping)
    notes = _connection_notes(loop, mapping, plant, controller, wiring) + units.notes + states
    notes += fixed_step_notes(step, plant) + fixed_step_notes(loop.sampled or step, controller)
    run = run_loop(
        plant,
        controller,
        loop.reference,
        loop.stop,
        step,
        coupling=loop.coupling,
        corrections=loop.corrections,
        adaptive=loop.adaptive,
        plant_values=of_plant,
        controller_values=of_controller,
        mapping=mapping,
        wiring=wiring,
        progress=progress,
        look_again=look_again,
        tries=tries,
    )
    factor, offset = units.set_point
    told = _units(plant, run, mapping, units.commands)
    reference = factor * run.reference + offset
    run = replace(run, units=told, reference=reference, scale=units.set_point)
    notes += (*plant.notes, *controller.notes)
    run = limited(run, loop.plant_values)
    notes += coarse_notes(run, loop.reference)
    notes += amplifier_notes(run, plant.parameters, loop.plant_values, "--limit-voltage ")
    return run, notes


def _units(
    plant: _Fmu, run: LoopRun, mapping: Mapping[str, str], commands: Mapping[str, str]
) -> dict[str, str]:
    units = {v.name: v.unit for v in plant.description.variables} | dict(commands)
    ours = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    recorded = {**run.outputs, **run.commands}
    return {ours[n]: units[n] for n in ours if ours[n] in recorded}


def _connection_notes(
    loop: Loop, mapping: Mapping[str, str], plant: _Fmu, controller: _Fmu, wiring: Wiring
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


def fixed_step_notes(step: float, *fmus: _Fmu) -> tuple[str, ...]:
    """Notes on FMUs that do not allow the steps of the run."""
    return tuple(
        f"{fmu.path.stem} requires steps "
        f"{f'of {size:g} s' if size else 'of constant length'}; this run and its checks use "
        "other steps, so do not rely on the verdict alone"
        for fmu in fmus
        if not fmu.description.steps_vary and (size := fmu.description.step_size) != step
    )


def amplifier_notes(
    run: LoopRun, parameters: Iterable[str], values: Mapping[str, float], option: str
) -> tuple[str, ...]:
    """A note if the command exceeds the limit of the nominal amplifier; `option` sets one."""
    limit = values.get(LIMIT, UNLIMITED)
    of_motor = {LIMIT, CURRENT_LIMIT} <= {*parameters}
    if not of_motor or "u" not in run.commands or limit <= NOMINAL_VOLTAGE:
        return ()
    peak = float(np.max(np.abs(run.commands["u"])))
    if not peak > NOMINAL_VOLTAGE or run.stopped:  # the peak of a diverged loop is meaningless
        return ()
    has = "has no limit" if limit >= UNLIMITED else f"is limited to {limit:g} V"
    return (
        f"the peak of {peak:.4g} V is more than the {NOMINAL_VOLTAGE:g} V of the nominal "
        f"amplifier, and this run {has}; with {option}{NOMINAL_VOLTAGE:g} the motor would get at "
        f"most {NOMINAL_VOLTAGE:g} V",
    )


def limited(run: LoopRun, values: Mapping[str, float]) -> LoopRun:
    """The run with the limit of its plant, from the plant's values."""
    return replace(run, limit=values.get(LIMIT, UNLIMITED))


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
