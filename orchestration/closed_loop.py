"""Closed-loop runs by name or by file, as the command line starts them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ..fmus.catalogue import NAMES, fmu, fmu_kernel, has_equations, name_of
from ..fmus.interface import TOLERANCE, interface_of
from ..fmus.reading import Description, unpack
from ..fmus.set_point import SET_POINT
from ..instruments.supply import NOMINAL_VOLTAGE, UNLIMITED
from .closed_loop_result import ClosedLoopResult
from .couplings import Coupling
from .fmu_instance import FmuInstance
from .isolated import TIME_LIMIT, IsolatedInstance, open_fmu
from .loop_run import CouplingError, LoopRun
from .master import Progress, run_loop
from .parameter_file import ParameterFile
from .parts import label_of, loop_label, part_of, used_parameters
from .port_units import convert
from .reference_signal import Reference
from .sampling import UnknownPeriod, sampling_period
from .state_trial import check_state
from .step_choice import FIRST, choose_step, only_step
from .whole_loop import run_monolithic
from .wiring import CONTROLLER, PLANT, Wiring, names_on, wire

LIMIT = "voltage_limit"  # the plant's parameter
_Fmu = FmuInstance | IsolatedInstance


class BadParameter(ValueError):
    """A parameter does not exist or has a value that makes no sense."""


@dataclass(frozen=True)
class Study:
    """What to run.

    Parameters
    ----------
    controller, plant : str
        A name of the catalogue, a file's function (``mine.py:pi``) or the path of an FMU.
    reference : Reference
    stop : float
        [s]
    step : float, optional
        [s] Default: it chooses itself, see `choose_step`.
    coupling : Coupling, optional
    corrections : int, optional
    adaptive : bool
    plant_values, controller_values : mapping of str to float
        Parameters that are not default.
    mapping : mapping of str to str
        Names of a third-party FMU's ports, ``theirs -> ours``.
    isolate : bool, optional
        Whether FMUs run each in a process of its own. Default: those that were not written here.
    time_limit : float
        Longest time that one call of an FMU in a process of its own may take [s].
    told : ParameterFile, optional
        Where values come from; the written parameter file keeps their intervals and sources.
    notes : tuple of str
        What is known before the run, and told with what the run says.
    """

    controller: str
    plant: str = "plant"
    reference: Reference = field(default_factory=lambda: Reference.constant(0.08))
    stop: float = 20.0
    step: float | None = None
    coupling: Coupling | None = None
    corrections: int | None = None
    adaptive: bool = False
    plant_values: Mapping[str, float] | None = None
    controller_values: Mapping[str, float] | None = None
    mapping: Mapping[str, str] | None = None
    isolate: bool | None = None
    time_limit: float = TIME_LIMIT
    told: ParameterFile | None = None
    notes: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """What to call the loop in tables and pictures."""
        return loop_label(self.plant, self.controller)

    def parameters(self) -> ParameterFile:
        """All parameters of plant and controller as they are used."""
        controllers = {self.controller: self.controller_values or {}}
        return used_parameters(self.plant, self.plant_values or {}, controllers, self.told)


def run_study(study: Study, progress: Progress | None = None) -> ClosedLoopResult:
    """Run a closed loop.

    Raises
    ------
    FmuError, WiringError, CouplingError, BadParameter, UnknownComponent, BadComponentFile
        If the study cannot be run as asked; the message says why.
    StepFailed
        If a part refuses its initial values.
    """
    notes: tuple[str, ...] = ()

    def run_at(step: float, look_again: bool = True, tries: bool = False) -> LoopRun:
        nonlocal notes
        run, found = _run_once(replace(study, step=step), progress, look_again, tries)
        notes = *study.notes, *found
        return run

    first = min(FIRST, study.stop)
    if study.step is not None or study.adaptive or study.coupling is Coupling.MONOLITHIC:
        run = run_at(study.step or first)
        return ClosedLoopResult(study, run, notes)
    if own := _own_step(study):
        run, choice = only_step(run_at(own), own)
        return ClosedLoopResult(study, run, notes, choice)
    run, choice = choose_step(run_at, first, partial(run_at, tries=True))
    return ClosedLoopResult(study, run, notes, choice)


def _own_step(study: Study) -> float:
    """The one step that a third-party FMU takes [s]; 0 where all take any."""
    names = (study.plant, study.controller)
    return own_step({n: unpacked_description(n) for n in names if not has_equations(n)})


def own_step(fmus: Mapping[str, Description]) -> float:
    """The one step that FMUs of fixed steps take [s]; 0 where there are none.

    Raises
    ------
    CouplingError
        If two of them take different ones.
    """
    sizes = {n: a.step_size for n, a in fmus.items() if not a.steps_vary and a.step_size}
    if len(set(sizes.values())) > 1:
        told = " and ".join(f"{Path(n).name} of {size:g} s" for n, size in sizes.items())
        raise CouplingError(f"there is no step for all: {told} take steps of that length alone")
    return next(iter(sizes.values()), 0.0)


def unpacked_description(name: str) -> Description:
    """The description of an FMU by file.

    Raises
    ------
    FmuError
    """
    fmu = unpack(name)
    fmu.remove()
    return fmu.description


def _run_once(
    study: Study, progress: Progress | None, look_again: bool, tries: bool
) -> tuple[LoopRun, tuple[str, ...]]:
    """A run with the study's step, and notes on it."""
    assert study.step is not None
    if study.coupling is Coupling.MONOLITHIC:
        run = _monolithic(study, study.step, progress)
        return run, amplifier_notes(run, [LIMIT], study.plant_values or {}, "--limit-voltage ")
    with contextlib.ExitStack() as opened:
        plant = open_fmu(_file(study.plant), "plant", study.isolate, study.time_limit)
        opened.callback(plant.close)
        path = _file(study.controller)
        controller = open_fmu(path, "controller", study.isolate, study.time_limit)
        opened.callback(controller.close)
        return run_parts(study, plant, controller, progress, look_again, tries)


def run_parts(
    study: Study,
    plant: _Fmu,
    controller: _Fmu,
    progress: Progress | None = None,
    look_again: bool = True,
    tries: bool = False,
) -> tuple[LoopRun, tuple[str, ...]]:
    """As `run_study`, with the study's step, of parts that are open and not initialized.

    Returns
    -------
    LoopRun
    tuple of str
        Notes on it.
    """
    assert study.step is not None
    for side, values in ((plant, study.plant_values), (controller, study.controller_values)):
        check_values(side.name, values or {}, [*side.parameters, *side.inputs])
    given = ((plant, study.plant_values), (controller, study.controller_values))
    states = [check_state(fmu, v or {}, study.stop, study.step) for fmu, v in given]
    wiring = wire(plant, controller, study.mapping)
    wiring.check_given(study.plant_values or {}, study.controller_values or {})
    controller, units = convert(plant, controller, wiring, study.mapping)
    notes = _connection_notes(study, plant, controller, wiring) + units.notes
    notes += states[0] + states[1]
    if not has_equations(study.controller):
        notes += _meet_samples(study, study.step, plant, controller, wiring)
    notes += fixed_step_notes(study.step, plant, controller)
    run = run_loop(
        plant,
        controller,
        study.reference,
        study.stop,
        study.step,
        coupling=study.coupling,
        corrections=study.corrections,
        adaptive=study.adaptive,
        plant_values=study.plant_values,
        controller_values=study.controller_values,
        mapping=study.mapping,
        wiring=wiring,
        progress=progress,
        look_again=look_again,
        tries=tries,
    )
    factor, offset = units.set_point
    told = _units(plant, run, study.mapping or {}, units.commands)
    reference = factor * run.reference + offset
    run = replace(run, units=told, reference=reference, scale=units.set_point)
    limits = study.plant_values or {}
    notes += amplifier_notes(run, plant.parameters, limits, "--limit-voltage ")
    return run, notes


def _units(
    plant: _Fmu, run: LoopRun, mapping: Mapping[str, str], commands: Mapping[str, str]
) -> dict[str, str]:
    units = {v.name: v.unit for v in plant.description.variables} | dict(commands)
    ours = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    return {ours[n]: units[n] for n in ours if ours[n] in {**run.outputs, **run.commands}}


def _connection_notes(
    study: Study, plant: _Fmu, controller: _Fmu, wiring: Wiring
) -> tuple[str, ...]:
    """Notes of inputs that nothing drives, and of one that is taken for the set-point."""
    notes = []
    for side, label, free, values in (
        (plant, label_of(study.plant), wiring.of_plant, study.plant_values),
        (controller, study.label, wiring.unconnected, study.controller_values),
    ):
        starts = {v.name: v.start or 0.0 for v in side.description.variables}
        notes += [
            f"nothing drives the input {name!r} of {label}: it stays at {starts[name]:g}; "
            f"--map {name}=NAME would connect it, --set {side.name}.{name}=VALUE gives it a value"
            for name in free
            if name not in (values or {})
        ]
    called = names_on(CONTROLLER, wiring.references, study.mapping or {})
    notes += [
        f"the input {name!r} of {study.label}, which nothing else drives, is taken for the "
        f"set-point {SET_POINT}"
        for name, order in zip(wiring.references, wiring.orders, strict=True)
        if order == 0 and called[name] != SET_POINT
    ]
    return tuple(notes)


def _meet_samples(
    study: Study, step: float, plant: _Fmu, controller: _Fmu, wiring: Wiring
) -> tuple[str, ...]:
    """Tell a third-party controller its own sampling period, where it has one; notes of it."""
    sizes = np.array([plant.nominal(name) for name, _ in wiring.signals])
    values = study.controller_values or {}
    try:
        period = sampling_period(controller, wiring, sizes, values, study.stop, step)
    except UnknownPeriod as error:
        raise CouplingError(str(error)) from error
    notes: tuple[str, ...] = ()
    if period.seconds > 0:
        controller.sample_time = period.seconds
        notes += (
            f"{study.label} is sampled every {period.seconds:g} s, by {period.found}; it is "
            "coupled so",
        )
    return notes


def fixed_step_notes(step: float, *fmus: _Fmu) -> tuple[str, ...]:
    """Notes of FMUs whose steps may not be as long as those of the run."""
    return tuple(
        f"{fmu.path.stem} says that its steps have to be "
        f"{f'of {size:g} s' if size else 'all of one length'}; this run and its checks take "
        "others, so do not rely on the verdict alone"
        for fmu in fmus
        if not fmu.description.steps_vary and (size := fmu.description.step_size) != step
    )


def amplifier_notes(
    run: LoopRun, parameters: Iterable[str], values: Mapping[str, float], option: str
) -> tuple[str, ...]:
    """A note where a plant with an amplifier is asked for more than the nominal one gives.

    Parameters
    ----------
    run : LoopRun
    parameters : iterable of str
        Of the plant.
    values : mapping of str to float
        Those of its parameters that are not default.
    option : str
        What sets the amplifier's limit.
    """
    limit = values.get(LIMIT, UNLIMITED)
    if LIMIT not in parameters or "u" not in run.commands or limit <= NOMINAL_VOLTAGE:
        return ()
    peak = float(np.max(np.abs(run.commands["u"])))
    if not peak > NOMINAL_VOLTAGE or run.stopped:  # how a loop diverged says nothing of amplifiers
        return ()
    has = "has no limit" if limit >= UNLIMITED else f"is limited to {limit:g} V"
    return (
        f"the peak of {peak:.4g} V is more than the {NOMINAL_VOLTAGE:g} V of the nominal "
        f"amplifier, and this run {has}; with {option}{NOMINAL_VOLTAGE:g} the motor would get at "
        f"most {NOMINAL_VOLTAGE:g} V",
    )


def _monolithic(study: Study, step: float, progress: Progress | None) -> LoopRun:
    for name in (study.plant, study.controller):
        if not has_equations(name):
            raise CouplingError(
                f"the monolithic coupling needs the equations of {name}, and an FMU does not give "
                f"them; it knows {', '.join(NAMES)}, and FILE.py:FUNCTION"
            )
    if study.adaptive or study.corrections or study.mapping:
        raise CouplingError("the monolithic coupling has no steps to adapt, correct or map")
    check_named("plant", study.plant, study.plant_values or {})
    check_named("controller", study.controller, study.controller_values or {})
    return run_monolithic(
        study.plant,
        study.controller,
        study.reference,
        study.stop,
        step,
        plant_values=study.plant_values,
        controller_values=study.controller_values,
        progress=progress,
    )


def check_named(side: str, name: str, values: Mapping[str, float]) -> None:
    """Make sure that a part with equations has these parameters, and that they are in range.

    Raises
    ------
    BadParameter
    """
    ranges = dict(interface_of(fmu_kernel(name), name_of(name)).layout.ranges)
    ranges.pop(TOLERANCE, None)  # a setting of the FMU's own solver
    check_values(side, values, list(ranges))
    for parameter, value in values.items():
        low, high = ranges[parameter]
        if (low is not None and value < low) or (high is not None and value > high):
            raise BadParameter(
                f"{side}: parameter {parameter} = {value:g} is out of its range "
                f"[{'-inf' if low is None else low}, {'inf' if high is None else high}]"
            )


def check_part_values(side: str, name: str, values: Mapping[str, float]) -> None:
    """As `check_named`, of a part by name or by file; a file tells no ranges.

    Raises
    ------
    BadParameter
    FmuError
        If the file is no FMU that can run here.
    """
    if has_equations(name):
        check_named(side, name, values)
    else:
        part = part_of(name)  # which inputs are free only the wiring tells
        check_values(side, values, [*part.parameters, *part.inputs])


def _file(name: str) -> Path:
    return fmu(name) if has_equations(name) else Path(name)


def check_values(side: str, values: Mapping[str, float], known: list[str]) -> None:
    """Make sure that every value has a variable.

    Raises
    ------
    BadParameter
        Naming the nearest.
    """
    import difflib

    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
            hint = f"; nearest: {', '.join(near)}" if near else f"; it has {', '.join(known)}"
            raise BadParameter(f"{side} has no parameter {name!r}{hint}")
