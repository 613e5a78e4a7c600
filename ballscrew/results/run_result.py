"""The result of one closed-loop run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.closed_loop_result import ClosedLoopResult
from ..orchestration.metrics import units_of_figures
from ..orchestration.page import Figure, plotly_figure
from ..orchestration.shown_units import quantity
from .reported import Reported, Table, figures_table, values_of
from .result import table_of


@dataclass(frozen=True, repr=False)
class RunResult(Reported, ClosedLoopResult):
    """A closed-loop run; see `ballscrew.run`."""

    kind, function = "Run", "ballscrew.run"

    def pictures(self) -> dict[str, Any]:
        from ..orchestration.pictures import run_figures

        return run_figures(self)

    def headline(self) -> str:
        return f"{self.loop.label}, {self.run.verdict.word}: {self.run.verdict.reason}"

    def verdict_and_reason(self) -> tuple[str, str]:
        return f"{self.loop.label}: {self.run.verdict.word}", self.run.verdict.reason

    def doubts(self) -> Iterable[str]:
        return filter(None, (self.run.stopped, self.run.verdict.advice, *self.notes))

    def page_pictures(self) -> list[Figure]:
        from ..orchestration.page_courses import pictures_of_run

        return [plotly_figure(p) for p in pictures_of_run(self.run)]

    def tables(self) -> list[Table]:
        figures = {n: v for n, v in self.figures().items() if n not in ("controller", "notes")}
        return [figures_table("metrics.json", figures, units_of_figures(self.run.units))]

    def values_used(self) -> list[Table]:
        return values_of(self.loop)

    def facts(self) -> Iterable[tuple[str, str]]:
        figures = self.figures()
        for name, unit in units_of_figures(self.run.units).items():
            if name in figures and name != "peak_voltage_time":
                yield name.replace("_", " "), quantity(figures[name], unit)
        yield "communication steps", str(figures["macro_steps"])
        yield "coupling", figures["coupling"]

    def to_pandas(self) -> Any:
        """All signals in SI units, a `pandas.DataFrame` over ``time`` [s]."""
        columns = {"time": self.run.time, **self.run.outputs, **self.run.commands}
        return table_of({**columns, "x_d": self.run.reference}, "time")
