"""The result of a closed-loop run, and its files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...solver.files import write_atomically, write_json
from ..master.loop_run import LoopRun
from ..master.step_choice import StepChoice
from .loop import Loop, SystemLoop
from .metrics import metrics

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
