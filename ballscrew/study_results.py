"""Results of exponents, maps, studies and tunings."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .controllers.margins import Margins
from .orchestration.loop.pictures import drawing
from .orchestration.loop.run_folder import write_run
from .orchestration.loop.shown import REPORT, Table, length
from .orchestration.study.result import StudyResult
from .orchestration.study.tune import TunedController
from .result import Result, figures_table, table_of, values_of, write_page
from .solver.files import read_table, table_path
from .stability.attractor import Kind
from .stability.lyapunov import LyapunovRun
from .stability.map_plan import TABLE
from .stability.stability_map import AGAIN, MapSummary

BITS = 1.0 / math.log(2.0)  # per nat
_LISTS = ("exponents", "exponents_error", "asymptotic", "asymptotic_error")


@dataclass(frozen=True, repr=False)
class Exponents(Result, LyapunovRun):
    """Lyapunov exponents of a closed loop; see `ballscrew.lyapunov`."""

    function = "ballscrew.lyapunov"

    @property
    def trusted(self) -> bool:
        """Whether the loop's attractor could be classified."""
        return self.decided

    @property
    def verdict(self) -> str:
        """The kind of the long-term motion, such as ``settles``."""
        return self.motion.kind.value

    def pictures(self) -> dict[str, Any]:
        from .stability.pictures import convergence_figure

        return {"lyapunov": convergence_figure(self)}

    def headline(self) -> str:
        return f"{self.label}: {self.verdict} ({self.motion.evidence})"

    def doubts(self) -> Iterable[str]:
        if not self.decided:
            yield f"Undecided; what would decide: {self.motion.would_decide}"
        reached = float(self.spectrum.time[-1])
        if self.loop and reached < self.loop.stop and self.motion.since is None:
            yield f"The exponents are those until t = {reached:g} s, not {self.loop.stop:g} s."
        if self.tighter is None:
            yield "The error of the exponents is not known."

    def tables(self) -> list[Table]:
        from .stability.pictures import moved_by

        figures = self.figures()
        _, errors, _, limit_errors = (figures.pop(f"{n}_bits_per_s") for n in _LISTS)
        limits = [] if self.motion.limit is None else self.motion.limit.tolist()
        rows = [
            (
                f"{k + 1}",
                self.shown(value),
                "not known" if math.isnan(errors[k]) else f"{errors[k]:.3g}",
                self.shown(limits[k]) if k < len(limits) else "-",
                f"{limit_errors[k]:.6g}" if limit_errors and k < len(limit_errors) else "-",
            )
            for k, value in enumerate(self.exponents)
        ]
        from_ = f"+- (bound, from {moved_by(self)})"
        columns = ("exponent", "bits/s", from_, "limit", "+- (bound)")
        used = [] if self.loop is None else values_of(self.loop, self.loop.step is not None)
        others = figures_table("lyapunov.json", figures, {})
        title = f"Exponents ({self.note})" if self.note else "Exponents"
        return [Table(title, columns, rows), others, *used]

    def to_pandas(self) -> Any:
        """A row for each exponent: finite-time value, its error and the limit [bits/s]."""
        limit = self.motion.limit
        return table_of(
            {
                "exponent": self.exponents * BITS,
                "error": self.error * BITS,
                "limit": [math.nan] * len(self.exponents) if limit is None else limit * BITS,
            }
        )


@dataclass(frozen=True, repr=False)
class StabilityMap(Result):
    """A map over two parameters, in its folder; see `ballscrew.stability_map`.

    Attributes
    ----------
    summary : MapSummary
    folder : Path
        Holds ``map.parquet`` (``map.csv`` without pyarrow) and ``map.json``.
    """

    summary: MapSummary
    folder: Path
    function = "ballscrew.stability_map"

    @property
    def trusted(self) -> bool:
        """Whether cells are decided, and none away from borders has another verdict when repeated.

        It is repeated at a tenth of the tolerance.
        """
        return self.summary.random_disagreed == 0 and self._undecided < self.summary.plan.cells

    @property
    def _undecided(self) -> int:
        return self.summary.verdicts.get(Kind.UNDECIDED.value, 0)

    @property
    def badge(self) -> str:
        if self._undecided and not self.summary.random_disagreed:
            return f"{self._undecided} of {self.summary.plan.cells} undecided"
        return super().badge

    @property
    def good(self) -> bool:
        return self.trusted and not self._undecided

    def pictures(self) -> dict[str, Any]:
        from .stability.pictures import map_figure

        return {"map": map_figure(self.summary.plan, self.folder)}

    def headline(self) -> str:
        s = self.summary
        counts = sorted(s.verdicts.items(), key=lambda row: -row[1])
        ends = ", ".join(f"{count} {verdict}" for verdict, count in counts)
        return (
            f"{s.plan.cells} loops of {s.plan.loop.label}: {ends}; at {AGAIN} "
            f"{s.disagreed} of {s.checked} have another verdict"
        )

    def doubts(self) -> Iterable[str]:
        s = self.summary
        if s.random_disagreed:
            yield f"Away from borders, {s.random_disagreed} of {s.random_checked} cells changed."
        yield from (f"{n} cells are undecided: {reason}" for reason, n in s.undecided.items())
        yield from s.notes

    def tables(self) -> list[Table]:
        plan, figures = self.summary.plan, self.summary.figures()
        counts = [(verdict, str(n)) for verdict, n in figures.pop("verdicts").items()]
        del figures["study"]  # the values used
        rows = [
            (side, axis.name, f"{axis.low:.9g}", f"{axis.high:.9g}", str(axis.count))
            for side, axis in (("x", plan.x), ("y", plan.y))
        ]
        return [
            Table("Verdicts", ("verdict", "cells"), counts),
            figures_table("map.json", figures, {}),
            Table("Axes", ("axis", "parameter", "from", "to", "points"), rows),
            *values_of(plan.loop, coupled=False),
        ]

    def add_report(self, command: str = "") -> list[str]:
        """Write the page into the map's own folder; returns notes as `write_run` does."""

        def write(stage: Path) -> None:
            with drawing(REPORT):
                write_page(stage, self.report(command))

        return write_run(self.folder, write, adds=True)

    def write(self, folder: Path) -> None:
        """Copy the map's files to another folder."""
        for name in (self._table.name, "map.json"):
            if (self.folder / name).is_file() and folder.resolve() != self.folder.resolve():
                shutil.copyfile(self.folder / name, folder / name)

    def columns(self) -> dict[str, list[Any]]:
        """The map's table by column, a value for each cell: along `x` first, then along `y`."""
        return read_table(self._table)

    def to_pandas(self) -> Any:
        """A row for each cell, as in the map's table."""
        return table_of(self.columns())

    @property
    def _table(self) -> Path:
        return table_path(self.folder, TABLE)


@dataclass(frozen=True, repr=False)
class SwapStudy(StudyResult, Result):
    """A controller swap study; see `ballscrew.swap_study`."""

    function = "ballscrew.swap_study"

    def tables(self) -> list[Table]:
        from .orchestration.study.report import tables_of

        return tables_of(self)

    def pictures(self) -> dict[str, Any]:
        from .orchestration.study.report import courses_figure, effort_figure

        return {"study": effort_figure(self), "courses": courses_figure(self)}

    def to_pandas(self) -> Any:
        """A row for each run, as in the table ``runs``."""
        return table_of(self.rows())


@dataclass(frozen=True, repr=False)
class TunedGains(TunedController, Result):
    """Gains of one controller for one machine; see `ballscrew.tune`."""

    function = "ballscrew.tune"

    @property
    def values(self) -> dict[str, float]:
        """The gains by name."""
        return {g.name: g.value for g in self.gains}

    def pictures(self) -> dict[str, Any]:
        from .orchestration.study.report import bode_figure, motions_figure

        pictures = {"motions": motions_figure(self)}
        return {**pictures, "bode": bode_figure(self)} if self.margins else pictures

    def headline(self) -> str:
        judged = self.motions[-1].figures
        said = [
            f"{self.loop.title}: on a motion not used for tuning, the error is "
            f"{length(judged.rms_error)} rms and {length(judged.peak_error)} at most"
        ]
        said += [_margins(m) for m in self.margins]
        said += self.no_margins
        weak = self.doubts()
        return "; ".join(said) + (f". Limitations: {', '.join(weak)}" if weak else "")

    def tables(self) -> list[Table]:
        gains = [
            (g.name, f"{g.value:.6g} {g.unit}", f"searched {g.low:.3g} to {g.high:.3g}")
            for g in self.gains
        ]
        return [
            Table("Gains", ("gain", "value", "range"), gains),
            Table("Motions", ("motion", "error and command"), [*self._motions()]),
            figures_table("tuning.json", self.to_dict(), {}),
            *values_of(self.loop, coupled=False),
        ]

    def _motions(self) -> Iterator[tuple[str, str]]:
        for m in self.motions:
            f = m.figures
            turn = "" if math.isnan(f.reversal_error) else f", {length(f.reversal_error)} at turns"
            yield (
                m.duty.name,
                f"{length(f.rms_error)} rms, {length(f.peak_error)} at most{turn}; command "
                f"{f.peak_command:.4g} of {self.limit:g} {self.plan.command_unit}",
            )

    def to_pandas(self) -> Any:
        """A row for each gain."""
        return table_of([vars(g) for g in self.gains], "name")


def _margins(m: Margins) -> str:
    state = f"sliding at {m.speed:g} m/s" if m.speed else "stuck"
    if not m.stable:
        return f"{state}: unstable"
    gain = "no end" if math.isinf(m.gain_margin) else f"{m.gain_margin:.3g}"
    phase = "none, its gain stays below one"
    if not math.isnan(m.phase_margin):
        phase = f"{m.phase_margin:.3g} degrees at {m.crossover:.3g} Hz"
    return f"{state}: gain margin {gain}, phase margin {phase}, Ms {m.sensitivity:.3g}"
