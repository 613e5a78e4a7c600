"""Run closed loops: a pair of parts, the elements of an .ssp, or several controllers on a plant."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ...fmus.ports import reference_port
from ...solver.errors import CouplingError, FmuError
from ...solver.files import write_atomically, write_json
from ...solver.set_point import SET_POINT
from ..fmu.fmu_instance import StepFailed
from ..fmu.isolated import open_fmu
from ..fmu.limits import FIRST_STEP
from ..fmu.trials import answers_in_steps, sampled_every
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
from ..master.couplings import Coupling
from ..master.loop_run import LoopRun
from ..master.march import Progress
from ..master.step_choice import StepChoice
from .catalogue import NAMES
from .joined import Fmu, Joined, amplifier_notes, limited, own_step
from .loop import Loop, SystemLoop
from .metrics import metrics
from .parameter_file import ParameterFile
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
        of_plant, of_controller = (joined.fmus[side].kept for side in (PLANT, CONTROLLER))
    if of_plant or of_controller:  # what the results name is what the FMUs have
        given = {**loop.plant_values, **of_plant}, {**loop.controller_values, **of_controller}
        loop = replace(loop, plant_values=given[0], controller_values=given[1])
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


ROWS = 10_000  # of a table that are text in memory at a time
FIRST_COLUMNS = ("x", "v", "z", "i", "u")


@dataclass(frozen=True)
class ClosedLoopResult:
    """A run with its loop; `save` writes it as plain files."""

    loop: Loop | SystemLoop
    run: LoopRun
    notes: tuple[str, ...] = ()  # notes for the user, in addition to the verdict
    # how the communication step was chosen, if it was not given
    step_choice: StepChoice | None = None

    @property
    def trusted(self) -> bool:
        return self.run.verdict.trusted

    def figures(self) -> dict[str, Any]:
        """Content of ``metrics.json``."""
        run, verdict = self.run, self.run.verdict
        figures: dict[str, Any] = {"controller": self.loop.label}
        if {"x"} <= set(run.outputs) and {"u"} <= set(run.commands):
            figures |= metrics(run).to_dict()
        return figures | {
            "coupling_residual_max": max(run.residual_max.values(), default=0.0),
            "coupling_residual_effect_per_second": run.effect_rate_max,
            "error_estimate": verdict.error_estimate,
            "contraction": verdict.contraction,
            "macro_steps": run.macro_steps,
            "step_range": list(run.step_range),
            "step_reason": self.step_choice.reason if self.step_choice else "as asked",
            "steps_tried": [list(t) for t in self.step_choice.tried] if self.step_choice else [],
            "coupling": run.coupling.value,
            "coupling_reason": run.coupling_reason,
            "corrected": run.corrected,
            "sampling_period": run.sampling_period or None,
            "verdict": verdict.word,
            "verdict_reason": verdict.reason,
            "advice": verdict.advice,
            "stopped": run.stopped,
            "notes": list(self.notes),
            "end_time": float(run.time[-1]),
        }

    def trajectory_csv(self) -> Iterator[bytes]:
        """The table of ``trajectory.csv``, numbers with all their digits, piece by piece."""
        run = self.run
        columns = {**run.outputs, **run.commands}
        names = [n for n in FIRST_COLUMNS if n in columns]
        names += [n for n in columns if n not in names]
        table = [run.time, *(columns[n] for n in names)]
        if not run.alone:
            names, table = [*names, "x_d"], [*table, run.reference]
        names, table = [*names, *run.others], [*table, *run.others.values()]
        yield _csv_rows([["time", *names]])
        for first in range(0, len(run.time), ROWS):
            piece = [column[first : first + ROWS].tolist() for column in table]
            yield _csv_rows(map(repr, row) for row in zip(*piece, strict=True))

    def save(self, folder: Path | str) -> None:
        """Write trajectory.csv, metrics.json and parameters.toml."""
        folder = Path(folder)
        write_atomically(folder / "trajectory.csv", self.trajectory_csv())
        parameters = self.loop.parameters()
        if parameters is not None:
            parameters.save(folder)
        write_json(folder / "metrics.json", self.figures())


def _csv_rows(rows: Iterable[Iterable[str]]) -> bytes:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue().encode()


COLUMNS = (
    "controller peak_voltage peak_voltage_time settling_time_2pct overshoot steady_state_error iae "
    "rms_error largest_error coupling_residual_max macro_steps sampling_period coupling verdict"
).split()


@dataclass(frozen=True)
class SwapResult:
    """Results of several controllers in the requested order."""

    results: tuple[ClosedLoopResult, ...]
    failures: tuple[tuple[str, str], ...] = ()  # controllers that could not be run at all, and why

    @property
    def trusted(self) -> bool:
        return not self.failures and all(result.trusted for result in self.results)

    def parameters(self) -> ParameterFile:
        """Parameters of the plant and of all controllers."""
        files = [p for r in self.results if (p := r.loop.parameters()) is not None]
        controllers = {name: values for file in files for name, values in file.controllers.items()}
        return replace(files[0], controllers=controllers)

    @property
    def trajectories(self) -> list[str]:
        """A file's name for each result, by its label; numbered if labels are equal."""
        labels = [result.loop.label for result in self.results]
        before = [labels[:k].count(label) for k, label in enumerate(labels)]
        return [
            os.fsdecode(f"trajectory_{label}{f'_{n + 1}' if n else ''}.csv".encode())
            for label, n in zip(labels, before, strict=True)
        ]

    def save(self, folder: Path | str) -> None:
        """Write comparison.csv, comparison.json, trajectories and parameters.toml."""
        folder = Path(folder)
        self.parameters().save(folder)
        for name, result in zip(self.trajectories, self.results, strict=True):
            write_atomically(folder / name, result.trajectory_csv())
        figures = [result.figures() for result in self.results]
        rows = (["" if f[c] is None else str(f[c]) for c in COLUMNS] for f in figures)
        write_atomically(folder / "comparison.csv", _csv_rows([COLUMNS, *rows]))
        write_json(folder / "comparison.json", figures)


def swap(loops: Sequence[Loop], progress: Callable[[str, float], None] | None = None) -> SwapResult:
    """Run loops that differ in their controllers, one after the other.

    Errors are those of `run_closed_loop`, if no controller can be run; else failures are part of
    the result. `progress` gets a loop's label and the time that it has reached [s].
    """
    results, failures, errors = [], [], []
    for loop in loops:
        told = None if progress is None else (lambda t, name=loop.label: progress(name, t))
        try:
            results.append(run_closed_loop(loop, told))
        except (FmuError, CouplingError, StepFailed) as error:
            failures.append((loop.label, str(error)))
            errors.append(error)
    if not results and errors:
        raise errors[0]
    return SwapResult(tuple(results), tuple(failures))
