"""What the thesis says and prints, row by row, and what is computed here."""

from __future__ import annotations

import json
from pathlib import Path

from thesis import chapter_3, friction_laws, region_and_tables

SECTIONS = (*friction_laws.SECTIONS, *chapter_3.SECTIONS, *region_and_tables.SECTIONS)
FIGURES = Path(__file__).resolve().parents[2] / "docs" / "proof" / "thesis.json"


def table(letter: str) -> str:
    """The rows of a section as Markdown, from the stored figures."""
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))["figures"]
    return next(s for s in SECTIONS if s.letter == letter).table(figures)


def counted() -> str:
    """How many rows agree, in words, from the stored figures."""
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))["figures"]
    rows = [(row, figures[k]) for s in SECTIONS for k, row in s.labelled() if row.counted]
    agree = sum(row.agrees(here) for row, here in rows)
    return f"{len(rows)} numbers and statements: {agree} agree, {len(rows) - agree} differ."
