"""Closed-loop runs by name or by file, as the command line starts them."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from ..controllers import CONTROLLERS
from ..fmus.catalogue import fmu, fmu_kernel
from ..fmus.interface import TOLERANCE, interface_of
from ..plant import PLANTS
from ..solver.kernel_cache import write_atomically
from .coupling import Coupling
from .isolated import TIME_LIMIT, open_fmu
from .master import CouplingError, LoopRun, Progress, run_loop
from .metrics import metrics
from .reference_signal import Reference
from .whole_loop import run_monolithic

FIRST_COLUMNS = ("x", "v", "z", "i", "u")


class BadParameter(ValueError):
    """A parameter does not exist or has a value that makes no sense."""


@dataclass(frozen=True)
class Study:
    """What to run.

    Parameters
    ----------
    controller, plant : str
        A name of the catalogue or the path of an FMU.
    reference : Reference
    stop, step : float
        [s]
    coupling : Coupling, optional
    corrections : int, optional
    adaptive : bool
    plant_values, controller_values : mapping of str to float
        Parameters that are not default.
    mapping : mapping of str to str
        Names of a stranger's ports, ``theirs -> ours``.
    isolate : bool, optional
        Whether FMUs run each in a process of its own. Default: those that are not of the catalogue.
    time_limit : float
        Longest time that one call of an FMU in a process of its own may take [s].
    """

    controller: str
    plant: str = "plant"
    reference: Reference = field(default_factory=lambda: Reference.constant(0.08))
    stop: float = 20.0
    step: float = 1e-3
    coupling: Coupling | None = None
    corrections: int | None = None
    adaptive: bool = False
    plant_values: Mapping[str, float] | None = None
    controller_values: Mapping[str, float] | None = None
    mapping: Mapping[str, str] | None = None
    isolate: bool | None = None
    time_limit: float = TIME_LIMIT

    @property
    def label(self) -> str:
        """What to call the loop in tables and pictures."""
        return Path(self.controller).stem


class Labelled(Protocol):
    """A study, as far as results need it."""

    @property
    def label(self) -> str: ...


@dataclass(frozen=True)
class ClosedLoopResult:
    """A run with its study; `save` writes it as plain files.

    Attributes
    ----------
    study : Study or SystemStudy
    run : LoopRun
    notes : tuple of str
        What the user should know beside the verdict.
    """

    study: Labelled
    run: LoopRun
    notes: tuple[str, ...] = ()

    @property
    def trusted(self) -> bool:
        return self.run.verdict.trusted

    def figures(self) -> dict[str, Any]:
        """Everything of ``metrics.json``."""
        run, verdict = self.run, self.run.verdict
        figures: dict[str, Any] = {"controller": self.study.label}
        if {"x"} <= set(run.outputs) and {"u"} <= set(run.commands):
            figures |= metrics(run).to_dict()
        return figures | {
            "interface_defect_max": max(run.defect_max.values(), default=0.0),
            "interface_defect_effect_per_second": run.effect_rate_max,
            "error_estimate": verdict.error_estimate,
            "contraction": verdict.contraction,
            "macro_steps": run.macro_steps,
            "step_range": list(run.step_range),
            "coupling": run.coupling.value,
            "coupling_reason": run.coupling_reason,
            "corrected": run.corrected,
            "verdict": verdict.word,
            "verdict_reason": verdict.reason,
            "advice": verdict.advice,
            "stopped": run.stopped,
            "notes": list(self.notes),
            "end_time": float(run.time[-1]),
        }

    def trajectory_csv(self) -> str:
        """The table of ``trajectory.csv``, numbers with all their digits."""
        run = self.run
        columns = {**run.outputs, **run.commands}
        names = [n for n in FIRST_COLUMNS if n in columns]
        names += [n for n in columns if n not in names]
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time", *names, "x_d"])
        table = [run.time, *(columns[n] for n in names), run.reference]
        for row in zip(*(column.tolist() for column in table), strict=True):
            writer.writerow([repr(value) for value in row])
        return stream.getvalue()

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Write trajectory.csv, metrics.json and, unless told otherwise, the pictures."""
        folder = Path(folder)
        write_atomically(folder / "trajectory.csv", self.trajectory_csv().encode())
        write_json(folder / "metrics.json", self.figures())
        if pictures:
            from .pictures import save_run_pictures

            save_run_pictures(self, folder)


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON: numbers that are not finite become null."""
    write_atomically(path, (json.dumps(finite_or_null(data), indent=2) + "\n").encode())


def finite_or_null(data: Any) -> Any:
    """The same data with None for every number that strict JSON cannot write."""
    if isinstance(data, dict):
        return {key: finite_or_null(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite_or_null(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def run_study(study: Study, progress: Progress | None = None) -> ClosedLoopResult:
    """Run a closed loop.

    Raises
    ------
    FmuError, WiringError, CouplingError, BadParameter, UnknownComponent
        If the study cannot be run as asked; the message says why.
    StepFailed
        If a part refuses its initial values.
    """
    if study.coupling is Coupling.MONOLITHIC:
        return ClosedLoopResult(study, _monolithic(study, progress))
    with contextlib.ExitStack() as opened:
        plant = open_fmu(_file(study.plant, PLANTS), "plant", study.isolate, study.time_limit)
        opened.callback(plant.close)
        path = _file(study.controller, CONTROLLERS)
        controller = open_fmu(path, "controller", study.isolate, study.time_limit)
        opened.callback(controller.close)
        for side, values in ((plant, study.plant_values), (controller, study.controller_values)):
            check_values(side.name, values or {}, side.parameters)
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
            progress=progress,
        )
    return ClosedLoopResult(study, run)


def _monolithic(study: Study, progress: Progress | None) -> LoopRun:
    for name, known in ((study.plant, PLANTS), (study.controller, CONTROLLERS)):
        if name not in known:
            raise CouplingError(
                f"the monolithic coupling needs the equations of {name}, and an FMU does not give "
                f"them; it knows {', '.join(known)}"
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
        study.step,
        plant_values=study.plant_values,
        controller_values=study.controller_values,
        progress=progress,
    )


def check_named(side: str, name: str, values: Mapping[str, float]) -> None:
    """Make sure that a part of ours has these parameters, and that they are in range.

    Raises
    ------
    BadParameter
    """
    ranges = dict(interface_of(fmu_kernel(name), name).layout.ranges)
    ranges.pop(TOLERANCE, None)  # a setting of the FMU's own solver
    check_values(side, values, list(ranges))
    for parameter, value in values.items():
        low, high = ranges[parameter]
        if (low is not None and value < low) or (high is not None and value > high):
            raise BadParameter(
                f"{side}: parameter {parameter} = {value:g} is out of its range "
                f"[{'-inf' if low is None else low}, {'inf' if high is None else high}]"
            )


def _file(name: str, known: Mapping[str, str]) -> Path:
    return fmu(name) if name in known else Path(name)


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
