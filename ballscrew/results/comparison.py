"""The result of several controllers on one plant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.metrics import units_of_figures
from ..orchestration.swap import COLUMNS, SwapResult
from .result import Result, table_of, with_unit


@dataclass(frozen=True, repr=False)
class Comparison(Result, SwapResult):
    """Several controllers on one plant; see `ballscrew.swap`."""

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

    def facts(self) -> Iterable[tuple[str, str]]:
        for result in self.results:
            figures, units = result.figures(), units_of_figures(result.run.units)
            peak = with_unit(figures.get("peak_voltage"), units["peak_voltage"])
            settled = with_unit(figures.get("settling_time_2pct"), "s")
            yield result.loop.label, f"peak {peak}, settled in {settled}, {figures['verdict']}"
        yield from ((name, f"failed: {why}") for name, why in self.failures)

    def to_pandas(self) -> Any:
        """A row for each controller, with the columns of ``comparison.csv``."""
        rows = [{c: r.figures().get(c) for c in COLUMNS} for r in self.results]
        return table_of(rows, "controller")
