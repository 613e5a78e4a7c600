"""A row of the comparison with the thesis: what it says and prints, and what is computed here."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A statement of the thesis as a number that is computed here."""

    where: str  # section, equation, table or figure
    says: str  # what the number is, with its unit
    printed: str | float  # empty: the thesis prints nothing to compare with
    here: Callable[[], float]
    allowed: tuple[float, float] = (-math.inf, math.inf)  # it agrees between these
    why: str = ""  # why it differs

    @property
    def counted(self) -> bool:
        return self.printed != ""

    def agrees(self, here: float) -> bool:
        low, high = self.allowed
        return low <= here <= high

    def verdict(self, here: float) -> str:
        """Text of the last column."""
        if self.counted:
            return "agrees" if self.agrees(here) else "**differs**"
        return "" if self.agrees(here) else "**our own check fails**"


@dataclass(frozen=True)
class Section:
    """Rows of one section; they are called by its letter and a number."""

    letter: str
    rows: tuple[Row, ...]

    def labelled(self) -> Iterator[tuple[str, Row]]:
        return ((f"{self.letter}{n}", row) for n, row in enumerate(self.rows, start=1))

    def table(self, figures: dict[str, float]) -> str:
        """The rows with their figures as Markdown, and why some differ."""
        lines = ["| | where | the thesis says | thesis | here | agrees from, to | |"]
        lines.append("|---|---|---|---|---|---|---|")
        reasons = []
        for label, row in self.labelled():
            here = figures[label]
            ends = "" if row.allowed == Row.allowed else "{:.7g}, {:.7g}".format(*row.allowed)
            printed = row.printed if row.counted else "-"
            printed = printed if isinstance(printed, str) else f"{printed:.10g}"
            cells = (label, row.where, row.says, printed, f"{here:.7g}", ends)
            lines.append("| " + " | ".join((*cells, row.verdict(here))).rstrip() + " |")
            reasons += ["", f"**{label}.** {row.why}"] if row.why else []
        return "\n".join([*lines, *reasons])


def near(
    where: str,
    says: str,
    printed: float,
    within: float,
    here: Callable[[], float],
    why: str = "",
) -> Row:
    """A row with a printed number, and the largest difference from it."""
    return Row(where, says, printed, here, (printed - within, printed + within), why)


def differing(rows: Mapping[str, Row], figures: dict[str, float]) -> list[str]:
    """A line for each difference that no reason is given for, and each failed check of our own."""
    return [
        f"{label} {row.where}: {row.says}: thesis {row.printed or '-'}, here {figures[label]:.7g}"
        for label, row in rows.items()
        if not row.agrees(figures[label]) and not (row.counted and row.why)
    ]
