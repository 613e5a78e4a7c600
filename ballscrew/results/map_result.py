"""A stability map in its folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..orchestration.page import Figure
from ..orchestration.pictures import drawing, write_figure
from ..orchestration.run_folder import write_run
from ..solver.tables import read_table, table_path
from ..stability.attractor import Kind
from ..stability.stability_map import AGAIN
from ..stability.store import TABLE, MapSummary
from .reported import Reported, Table, figures_table, values_of
from .result import table_of


@dataclass(frozen=True, repr=False)
class StabilityMap(Reported):
    """A map over two parameters, in its folder; see `ballscrew.stability_map`.

    Attributes
    ----------
    summary : MapSummary
    folder : Path
        Holds ``map.parquet`` (``map.csv`` without pyarrow) and ``map.json``.
    """

    summary: MapSummary
    folder: Path
    kind, function = "Map", "ballscrew.stability_map"

    @property
    def trusted(self) -> bool:
        """Whether cells are decided, and none away from borders has another verdict when repeated.

        It is repeated at a tenth of the tolerance.
        """
        return self.summary.random_disagreed == 0 and self._undecided < self.summary.plan.cells

    @property
    def _undecided(self) -> int:
        return self.summary.verdicts.get(Kind.UNDECIDED.value, 0)

    def pictures(self) -> dict[str, Any]:
        from ..stability.map_pictures import map_figure

        return {"map": map_figure(self.summary.plan, self.folder)}

    def headline(self) -> str:
        s = self.summary
        open_ = f", {self._undecided} undecided" if self._undecided else ""
        return (
            f"{s.plan.cells} loops of {s.plan.loop.label}{open_}; at {AGAIN} "
            f"{s.disagreed} of {s.checked} have another verdict"
        )

    def badge(self) -> tuple[str, bool]:
        if self._undecided and not self.summary.random_disagreed:
            return f"{self._undecided} of {self.summary.plan.cells} undecided", False
        return super().badge()

    def verdict_and_reason(self) -> tuple[str, str]:
        s = self.summary
        counts = sorted(s.verdicts.items(), key=lambda row: -row[1])
        ends = ", ".join(f"{count} {verdict}" for verdict, count in counts)
        again = f"Again at {AGAIN}"
        checked = f"{again}: {s.disagreed} of {s.checked} cells have another verdict."
        return f"{s.plan.cells} loops of {s.plan.loop.label}: {ends}", checked

    def doubts(self) -> Iterable[str]:
        s = self.summary
        if s.random_disagreed:
            yield f"Away from borders, {s.random_disagreed} of {s.random_checked} cells changed."
        yield from (f"{n} cells are undecided: {reason}" for reason, n in s.undecided.items())
        yield from s.notes

    def page_pictures(self) -> list[Figure]:
        from ..stability.map_pictures import page_figures

        return page_figures(self.summary.plan, self.folder)

    def tables(self) -> list[Table]:
        figures = self.summary.figures()
        counts = [(verdict, str(n)) for verdict, n in figures.pop("verdicts").items()]
        del figures["study"]  # the values used
        return [
            Table("Verdicts", ("verdict", "cells"), counts),
            figures_table("map.json", figures, {}),
        ]

    def values_used(self) -> list[Table]:
        plan = self.summary.plan
        rows = [
            (side, axis.name, f"{axis.low:.9g}", f"{axis.high:.9g}", str(axis.count))
            for side, axis in (("x", plan.x), ("y", plan.y))
        ]
        axes = Table("Axes", ("axis", "parameter", "from", "to", "points"), rows)
        return [axes, *values_of(plan.loop, coupled=False)]

    def add_report(self, command: str = "") -> list[str]:
        """Write the page into the map's own folder; returns notes as `write_run` does."""
        return write_run(self.folder, lambda stage: self.save_report(stage, command), adds=True)

    def facts(self) -> Iterable[tuple[str, str]]:
        for verdict, count in sorted(self.summary.verdicts.items(), key=lambda row: -row[1]):
            yield verdict, f"{count} of {self.summary.plan.cells}"
        for reason, count in self.summary.undecided.items():
            yield f"undecided: {reason}", f"{count}"

    def save(self, folder: Path | str, pictures: bool = True, command: str = "") -> None:
        """Copy the map's files to another folder, draw it there, and write its page."""
        import shutil

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name in (self._table.name, "map.json"):
            if (self.folder / name).is_file() and folder.resolve() != self.folder.resolve():
                shutil.copyfile(self.folder / name, folder / name)
        if pictures:
            with drawing():
                write_figure(self.plot(), folder, "map")
            self.save_report(folder, command)

    def columns(self) -> dict[str, list[Any]]:
        """The map's table by column, a value for each cell: along `x` first, then along `y`."""
        return read_table(self._table)

    def to_pandas(self) -> Any:
        """A row for each cell, as in the map's table."""
        return table_of(self.columns())

    @property
    def _table(self) -> Path:
        return table_path(self.folder, TABLE)
