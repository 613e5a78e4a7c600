"""What the thesis says and prints, row by row, and what is computed here."""

from __future__ import annotations

from provenance import stored

from thesis import chapter_3, friction_laws, region_and_tables

SECTIONS = (*friction_laws.SECTIONS, *chapter_3.SECTIONS, *region_and_tables.SECTIONS)
ROWS = {label: row for section in SECTIONS for label, row in section.labelled()}


def table(letter: str) -> str:
    """The rows of a section as Markdown, from the stored figures."""
    section = next(s for s in SECTIONS if s.letter == letter)
    return section.table(stored("thesis")["figures"])


def counted() -> str:
    """How many rows agree, in words, from the stored figures."""
    figures = stored("thesis")["figures"]
    agree = [row.agrees(figures[label]) for label, row in ROWS.items() if row.counted]
    return (
        f"{len(agree)} numbers and statements: {sum(agree)} agree, "
        f"{len(agree) - sum(agree)} differ."
    )
