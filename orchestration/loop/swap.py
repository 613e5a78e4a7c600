"""Several controllers on one plant, compared."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...solver.errors import CouplingError, FmuError
from ...solver.files import write_atomically, write_json
from ..fmu.fmu_instance import StepFailed
from .closed_loop import run_closed_loop
from .closed_loop_result import ClosedLoopResult
from .loop import Loop
from .parameter_file import ParameterFile

COLUMNS = (
    "controller",
    "peak_voltage",
    "peak_voltage_time",
    "settling_time_2pct",
    "overshoot",
    "steady_state_error",
    "iae",
    "rms_error",
    "largest_error",
    "coupling_residual_max",
    "macro_steps",
    "sampling_period",
    "coupling",
    "verdict",
)


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

    def comparison_csv(self) -> str:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for result in self.results:
            figures = result.figures()
            writer.writerow(["" if figures[c] is None else figures[c] for c in COLUMNS])
        return stream.getvalue()

    def save(self, folder: Path | str) -> None:
        """Write comparison.csv, comparison.json, trajectories and parameters.toml."""
        folder = Path(folder)
        self.parameters().save(folder)
        for name, result in zip(self.trajectories, self.results, strict=True):
            write_atomically(folder / name, result.trajectory_csv())
        write_atomically(folder / "comparison.csv", self.comparison_csv().encode())
        write_json(folder / "comparison.json", [result.figures() for result in self.results])


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
