"""The result of several controllers on one plant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.metrics import units_of_figures
from ..orchestration.page import Figure, plotly_figure
from ..orchestration.shown_units import quantity
from ..orchestration.swap import COLUMNS, SwapResult
from .reported import Reported, Table, told, values_of
from .result import table_of


@dataclass(frozen=True, repr=False)
class Comparison(Reported, SwapResult):
    """Several controllers on one plant; see `ballscrew.swap`."""

    kind, function = "Swap", "ballscrew.swap"

    def pictures(self) -> dict[str, Any]:
        from ..orchestration.pictures import comparison_figure

        return {"comparison": comparison_figure(self.results)}

    def headline(self) -> str:
        doubtful = [r.loop.label for r in self.results if not r.trusted]
        names = ", ".join(r.loop.label for r in self.results)
        failed = [name for name, _ in self.failures]
        return (
            f"{names or 'none'} on one plant"
            + (f"; not trusted: {', '.join(doubtful)}" if doubtful else "")
            + (f"; failed: {', '.join(failed)}" if failed else "")
        )

    def doubts(self) -> Iterable[str]:
        for r in self.results:
            verdict = r.run.verdict
            said = () if r.trusted else (f"{verdict.word}: {verdict.reason}", verdict.advice)
            for doubt in filter(None, (*said, r.run.stopped, *r.notes)):
                yield f"{r.loop.label}: {doubt}"
        yield from (f"{name} was left out: {why}" for name, why in self.failures)

    def page_pictures(self) -> list[Figure]:
        from ..orchestration.page_courses import pictures_of_runs

        labels = [r.loop.label + ("" if r.trusted else " (not trusted)") for r in self.results]
        pictures = pictures_of_runs(labels, [r.run for r in self.results])
        return [plotly_figure(p) for p in pictures]

    def tables(self) -> list[Table]:
        rows = []
        for r in self.results:
            figures, units = r.figures(), units_of_figures(r.run.units)
            rows.append(tuple(told(figures.get(c), units.get(c, "")) for c in COLUMNS))
        columns = tuple(c.replace("_", " ") for c in COLUMNS)
        return [Table("comparison.json", columns, rows)]

    def values_used(self) -> list[Table]:
        first, *others = (values_of(r.loop) for r in self.results)
        known = {table.title for table in first[:2]}  # the loop and its plant are the same
        return first + [t for tables in others for t in tables if t.title not in known]

    def facts(self) -> Iterable[tuple[str, str]]:
        for result in self.results:
            figures, units = result.figures(), units_of_figures(result.run.units)
            peak = quantity(figures.get("peak_voltage"), units["peak_voltage"])
            settled = quantity(figures.get("settling_time_2pct"), "s")
            yield result.loop.label, f"peak {peak}, settled in {settled}, {figures['verdict']}"
        yield from ((name, f"failed: {why}") for name, why in self.failures)

    def to_pandas(self) -> Any:
        """A row for each controller, with the columns of ``comparison.csv``."""
        rows = [{c: r.figures().get(c) for c in COLUMNS} for r in self.results]
        return table_of(rows, "controller")
