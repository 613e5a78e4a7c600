"""The result of one closed-loop run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.closed_loop_result import ClosedLoopResult
from ..orchestration.metrics import units_of_figures
from .result import Result, table_of, with_unit


@dataclass(frozen=True, repr=False)
class RunResult(Result, ClosedLoopResult):
    """A closed-loop run; see `ballscrew.run`."""

    def pictures(self) -> dict[str, Any]:
        from ..orchestration.pictures import run_figures

        return run_figures(self)

    def headline(self) -> str:
        return f"{self.loop.label}, {self.run.verdict.word}: {self.run.verdict.reason}"

    def facts(self) -> Iterable[tuple[str, str]]:
        figures = self.figures()
        for name, unit in units_of_figures(self.run.units).items():
            if name in figures and name != "peak_voltage_time":
                yield name.replace("_", " "), with_unit(figures[name], unit)
        yield "communication steps", str(figures["macro_steps"])
        yield "coupling", figures["coupling"]

    def to_pandas(self) -> Any:
        """All signals in SI units, a `pandas.DataFrame` over ``time`` [s]."""
        columns = {"time": self.run.time, **self.run.outputs, **self.run.commands}
        return table_of({**columns, "x_d": self.run.reference}, "time")
