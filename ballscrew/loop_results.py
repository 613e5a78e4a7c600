"""Results of runs and swaps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .orchestration.loop.closed_loop import COLUMNS, ClosedLoopResult, SwapResult
from .orchestration.loop.shown import Table
from .orchestration.master.march import LoopRun
from .result import Result, as_text, figures_table, table_of, values_of
from .solver.arrays import Vector


def units_of_figures(run: LoopRun) -> dict[str, str]:
    """The unit of each figure of a run; where ``x`` and ``u`` have none, those of the axis."""
    x, u = run.units.get("x") or "m", run.units.get("u") or "V"
    residual = max(run.residual_max, key=lambda n: run.residual_max[n], default="u")
    return {
        **dict.fromkeys(("overshoot", "steady_state_error", "rms_error", "largest_error"), x),
        **dict.fromkeys(("peak_voltage_time", "settling_time_2pct"), "s"),
        "peak_voltage": u,
        "iae": f"{x}*s",
        "coupling_residual_max": u if residual == "u" else run.units.get(residual, ""),
    }


@dataclass(frozen=True, repr=False)
class RunResult(Result, ClosedLoopResult):
    """A closed-loop run; see `ballscrew.run`.

    ``result["x"]`` is a signal, shape (n,), over ``result.time`` [s], in SI units.
    """

    function = "ballscrew.run"

    @property
    def time(self) -> Vector:
        """Times of all signals [s], shape (n,)."""
        return self.run.time

    @property
    def verdict(self) -> str:
        """``trusted`` or ``not converged``."""
        return self.run.verdict.word

    def __getitem__(self, name: str) -> Vector:
        return self.signals()[name]

    def signals(self) -> dict[str, Vector]:
        """Outputs, commands, the set-point ``x_d``, and signals of other parts, by name."""
        run = self.run
        return {**run.others, **run.outputs, **run.commands, "x_d": run.reference}

    def pictures(self) -> dict[str, Any]:
        from .orchestration.loop.pictures import run_figures

        return run_figures(self)

    def headline(self) -> str:
        return f"{self.loop.label}, {self.verdict}: {self.run.verdict.reason}"

    def doubts(self) -> Iterable[str]:
        return filter(None, (self.run.stopped, self.run.verdict.advice, *self.notes))

    def tables(self) -> list[Table]:
        figures = {n: v for n, v in self.figures().items() if n not in ("controller", "notes")}
        units = units_of_figures(self.run)
        return [figures_table("metrics.json", figures, units), *values_of(self.loop)]

    def to_pandas(self) -> Any:
        """All signals in SI units, a `pandas.DataFrame` over ``time`` [s]."""
        return table_of({"time": self.time, **self.signals()}, "time")


@dataclass(frozen=True, repr=False)
class Comparison(Result, SwapResult):
    """Several controllers on one plant; see `ballscrew.swap`."""

    function = "ballscrew.swap"

    def pictures(self) -> dict[str, Any]:
        from .orchestration.loop.pictures import comparison_figure

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

    def tables(self) -> list[Table]:
        rows = []
        for r in self.results:
            figures, units = r.figures(), units_of_figures(r.run)
            rows.append(tuple(as_text(figures.get(c), units.get(c, "")) for c in COLUMNS))
        columns = tuple(c.replace("_", " ") for c in COLUMNS)
        first, *others = (values_of(r.loop) for r in self.results)
        known = {table.title for table in first[:2]}  # the loop and its plant are the same
        more = [t for tables in others for t in tables if t.title not in known]
        return [Table("comparison.json", columns, rows), *first, *more]

    def to_pandas(self) -> Any:
        """A row for each controller, with the columns of ``comparison.csv``."""
        rows = [{c: r.figures().get(c) for c in COLUMNS} for r in self.results]
        return table_of(rows, "controller")
