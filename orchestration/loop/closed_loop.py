"""Run closed loops, one or several, and what their results say: figures, tables and files."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import CouplingError, FmuError
from ...solver.files import write_atomically, write_json
from ..fmu.fmu_instance import StepFailed
from ..master.march import LoopRun, Progress
from ..master.master import StepChoice
from .joined import as_it_answers, limited
from .loop import Loop, SystemLoop
from .parameter_file import ParameterFile
from .system import joined
from .whole_loop import run_monolithic

BAND = 0.02  # of a step
ROWS = 10_000  # of a table that are text in memory at a time
FIRST_COLUMNS = ("x", "v", "z", "i", "u")
COLUMNS = (
    "controller peak_voltage peak_voltage_time settling_time_2pct overshoot steady_state_error iae "
    "rms_error largest_error coupling_residual_max macro_steps sampling_period coupling verdict"
).split()


def run_closed_loop(loop: Loop | SystemLoop, progress: Progress = None) -> ClosedLoopResult:
    """Run a closed loop, with a verdict on its coupling."""
    if isinstance(loop, Loop):
        if not loop.fmus:
            run = limited(run_monolithic(loop, loop.step, progress), loop.plant_values)
            return ClosedLoopResult(loop, run, loop.notes)
        loop = as_it_answers(loop)
    with joined(loop) as both:
        run, choice, notes = both.run(progress)
        # what the results name is what the FMUs have
        mark = "_" if isinstance(loop, Loop) else "."  # after a name of an FMU in `values`
        kept = {f"{e}{mark}{n}": v for e, fmu in both.fmus.items() for n, v in fmu.kept.items()}
    if kept:
        loop = loop.with_values({**loop.values, **kept})
    digital = isinstance(loop, SystemLoop) or loop.controller.has_equations or run.sampling_period
    if not run.verdict.trusted and not digital:
        notes += (f"if {loop.label} is a digital controller, give its sampling period",)
    return ClosedLoopResult(loop, run, notes, choice)


def swap(loops: Sequence[Loop], progress: Callable[[str, float], None] | None = None) -> SwapResult:
    """Run loops that differ in their controllers, one after the other.

    Errors are those of `run_closed_loop`, if no controller can be run; else failures are part of
    the result. `progress` gets a loop's label and the time that it has reached [s].
    """
    results, failed = [], list[tuple[str, FmuError | CouplingError | StepFailed]]()
    for loop in loops:
        at = None if progress is None else partial(progress, loop.label)
        try:
            results.append(run_closed_loop(loop, at))
        except (FmuError, CouplingError, StepFailed) as error:
            failed.append((loop.label, error))
    if failed and not results:
        raise failed[0][1]
    return SwapResult(tuple(results), tuple((label, str(error)) for label, error in failed))


def metrics(run: LoopRun) -> dict[str, float | None]:
    """Figures of merit, from all that a run knows between its points; None: it does not define one.

    The peak is the largest magnitude of the command that the limit of the plant passes. The error
    is set-point minus position; the settling time is that from which on it stays within 2 % of the
    step, the overshoot is beyond the set-point. Both are None if the set-point moves, and the rms
    and largest error if it does not.
    """
    known = run.between or run
    time, x, goal = known.time, known.outputs["x"], known.reference
    command = np.minimum(np.abs(known.commands["u"]), run.limit)
    peak = int(np.argmax(command))
    error, step = goal - x, float(goal[0] - x[0])
    moves = bool(np.any(goal != goal[0]))
    steps = step != 0.0 and not moves
    beyond = (-np.inf, goal[0]) if step > 0.0 else (goal[0], np.inf)
    duration = max(float(time[-1] - time[0]), np.finfo(float).tiny)
    return {
        "peak_voltage": float(command[peak]),
        "peak_voltage_time": float(time[peak]),
        "settling_time_2pct": _settling(time, error, BAND * abs(step)) if steps else None,
        "overshoot": overshoot(x, *beyond) if steps else None,
        "steady_state_error": float(error[-1]),
        "iae": float(np.trapezoid(np.abs(error), time)),
        "rms_error": float(np.sqrt(np.trapezoid(error**2, time) / duration)) if moves else None,
        "largest_error": float(np.max(np.abs(error))) if moves else None,
    }


def settled_from(error: Vector, band: float) -> int | None:
    """The first sample from which on an error stays within a band; None if it ends outside."""
    outside = np.flatnonzero(np.abs(error) > band)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first < len(error) else None


def overshoot(position: Vector, low: float, high: float) -> float:
    """Largest distance of a position beyond a range."""
    return float(max(0.0, position.max() - high, low - position.min()))


def _settling(time: Vector, error: Vector, band: float) -> float | None:
    """Time from which on an error stays within a band, with straight lines between samples."""
    k = settled_from(error, band)
    if not k:
        return None if k is None else float(time[0])
    before, after = abs(error[k - 1]), abs(error[k])
    return float(time[k - 1] + (before - band) / (before - after) * (time[k] - time[k - 1]))


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
        run, verdict, choice = self.run, self.run.verdict, self.step_choice
        return {
            "controller": self.loop.label,
            **(metrics(run) if "x" in run.outputs and "u" in run.commands else {}),
            "coupling_residual_max": max(run.residual_max.values(), default=0.0),
            "coupling_residual_effect_per_second": run.effect_rate_max,
            "error_estimate": verdict.error_estimate,
            "contraction": verdict.contraction,
            "macro_steps": run.macro_steps,
            "step_range": list(run.step_range),
            "step_reason": choice.reason if choice else "as asked",
            "steps_tried": [list(t) for t in choice.tried] if choice else [],
            "coupling": run.coupled_by,
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
        named = {**run.outputs, **run.commands}
        named = {n: named[n] for n in FIRST_COLUMNS if n in named} | named
        goal = [] if run.alone else [("x_d", run.reference)]
        columns = [("time", run.time), *named.items(), *goal, *run.others.items()]
        names, table = zip(*columns, strict=True)
        yield _csv_rows([names])
        for first in range(0, len(run.time), ROWS):
            piece = [column[first : first + ROWS].tolist() for column in table]
            yield _csv_rows(zip(*piece, strict=True))

    def save(self, folder: Path) -> None:
        """Write trajectory.csv, metrics.json and parameters.toml."""
        write_atomically(folder / "trajectory.csv", self.trajectory_csv())
        if isinstance(self.loop, Loop):  # an .ssp holds its values
            self.loop.parameters().save(folder)
        write_json(folder / "metrics.json", self.figures())


def _csv_rows(rows: Iterable[Iterable[str | float]]) -> bytes:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue().encode()


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
        files = [r.loop.parameters() for r in self.results if isinstance(r.loop, Loop)]
        controllers = {name: values for file in files for name, values in file.controllers.items()}
        return replace(files[0], controllers=controllers)

    @property
    def trajectories(self) -> list[str]:
        """A file's name for each result, by its label; numbered if labels are equal."""
        labels = [result.loop.label for result in self.results]
        again = [labels[:k].count(label) for k, label in enumerate(labels)]
        numbers = [f"_{n + 1}" if n else "" for n in again]
        names = (f"trajectory_{n}{k}.csv" for n, k in zip(labels, numbers, strict=True))
        return [os.fsdecode(name.encode()) for name in names]

    def save(self, folder: Path) -> None:
        """Write comparison.csv, comparison.json, trajectories and parameters.toml."""
        self.parameters().save(folder)
        for name, result in zip(self.trajectories, self.results, strict=True):
            write_atomically(folder / name, result.trajectory_csv())
        figures = [result.figures() for result in self.results]
        rows = (["" if f[c] is None else str(f[c]) for c in COLUMNS] for f in figures)
        write_atomically(folder / "comparison.csv", _csv_rows([COLUMNS, *rows]))
        write_json(folder / "comparison.json", figures)
