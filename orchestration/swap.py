"""Several controllers on one plant, side by side."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..solver.kernel_cache import write_atomically
from .closed_loop import ClosedLoopResult, Study, run_study, write_json

COLUMNS = (
    "controller",
    "peak_voltage",
    "peak_voltage_time",
    "settling_time_2pct",
    "overshoot",
    "steady_state_error",
    "iae",
    "interface_defect_max",
    "macro_steps",
    "coupling",
    "verdict",
)


@dataclass(frozen=True)
class SwapResult:
    """Results of several controllers in the order asked for."""

    results: tuple[ClosedLoopResult, ...]

    @property
    def trusted(self) -> bool:
        return all(result.trusted for result in self.results)

    def comparison_csv(self) -> str:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for result in self.results:
            figures = result.figures()
            writer.writerow(["" if figures[c] is None else figures[c] for c in COLUMNS])
        return stream.getvalue()

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Write comparison.csv, comparison.json and, unless told otherwise, one picture."""
        folder = Path(folder)
        write_atomically(folder / "comparison.csv", self.comparison_csv().encode())
        write_json(folder / "comparison.json", [result.figures() for result in self.results])
        if pictures:
            from .pictures import save_comparison_picture

            save_comparison_picture(self.results, folder)


def swap(
    study: Study,
    controllers: Sequence[str],
    progress: Callable[[str, float], None] | None = None,
) -> SwapResult:
    """Run the same study with each controller.

    Parameters
    ----------
    study : Study
        Its own controller is ignored.
    controllers : sequence of str
        Names or paths.
    progress : function (controller, time), optional
    """
    results = []
    for controller in controllers:
        told = None if progress is None else (lambda t, name=controller: progress(name, t))
        results.append(run_study(replace(study, controller=controller), told))
    return SwapResult(tuple(results))
