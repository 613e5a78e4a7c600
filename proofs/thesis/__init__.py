"""What the thesis says and prints, row by row, and what is computed here.

``--only E5 G`` computes rows or sections, ``--only pictures`` draws the figures of Chapter 3
into ``docs/images``. The claim holds if each row that differs has its reason.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence

from thesis import chapter_3, friction_laws, region_and_tables

SECTIONS = friction_laws.SECTIONS | chapter_3.SECTIONS | region_and_tables.SECTIONS
ROWS = {f"{letter}{n}": row for letter, rows in SECTIONS.items() for n, row in enumerate(rows, 1)}


def tasks(asked: Namespace) -> dict[str, tuple[list[str]]]:
    """Sections, since their rows share runs, or the rows that are asked for."""
    if asked.only:
        return {label: ([label],) for label in (*ROWS, "pictures")}
    sections = {letter: ([k for k in ROWS if k[0] == letter],) for letter in SECTIONS}
    return sections | {"pictures": (["pictures"],)}


def trial(labels: Sequence[str]) -> dict[str, float]:
    if labels == ["pictures"]:
        from thesis import pictures

        pictures.save_all()
        return {}
    return {label: float(ROWS[label].here()) for label in labels}


def report(found: Sequence[dict[str, float]]) -> dict[str, object]:
    figures = {label: here for some in found for label, here in some.items()}
    differ = [k for k, here in figures.items() if not ROWS[k].agrees(here)]
    open_ones = [k for k in differ if not (ROWS[k].counted and ROWS[k].why)]
    return {"figures": figures, "without_a_reason": open_ones, "holds": not open_ones}


def says(report: dict[str, dict[str, float]]) -> str:
    figures = report["figures"]
    if len(figures) < len(ROWS):
        return "\n".join(ROWS[label].told(label, here) for label, here in figures.items())
    agree = [ROWS[label].agrees(here) for label, here in figures.items() if ROWS[label].counted]
    differ = len(agree) - sum(agree)
    return f"{len(agree)} numbers and statements: {sum(agree)} agree, {differ} differ."
