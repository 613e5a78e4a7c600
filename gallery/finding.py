"""A number of a system, computed here and from the literature."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """A number of a system.

    Attributes
    ----------
    what : str
        Description, with its parameters.
    ours : float
        As computed here.
    unit : str
        SI; "1" for none.
    source : str
        Source of `theirs`, or the way in which a number without one is checked.
    theirs : float or None
        Number in the literature.
    digit : float
        One unit of the last printed digit of `theirs`, or the error of a formula.
    remark : str
        Reason why the two differ.
    """

    what: str
    ours: float
    unit: str
    source: str
    theirs: float | None = None
    digit: float = 0.0
    remark: str = ""

    @property
    def agrees(self) -> bool | None:
        """Whether both are equal within one digit; None without `theirs`."""
        return None if self.theirs is None else bool(abs(self.ours - self.theirs) <= self.digit)


def table_of(findings: Sequence[Finding]) -> str:
    """The findings as a Markdown table."""
    head = "| what | ours | literature | agrees | source, or how ours is checked |"
    rows = [head, "|---|---|---|---|---|"]
    for f in findings:
        unit = "" if f.unit == "1" else f" {f.unit}"
        theirs = "-" if f.theirs is None else f"{_printed(f.theirs, f.digit)}{unit}"
        agrees = {True: "yes", False: "**no**", None: "-"}[f.agrees]
        source = f"{f.source}; {f.remark}" if f.remark else f.source
        rows.append(f"| {f.what} | {f.ours:.6g}{unit} | {theirs} | {agrees} | {source} |")
    return "\n".join(rows)


BEGIN, END = "<!-- findings -->", "<!-- end of findings -->"


def with_table(page: str, findings: Sequence[Finding]) -> str:
    """A page with an updated table of findings.

    Raises
    ------
    ValueError
        If the page has no place for a table.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{table_of(findings)}\n\n{END}{after}"


def line_of(f: Finding) -> str:
    """A finding as a line of text."""
    unit = "" if f.unit == "1" else f" {f.unit}"
    text = f"{f.what}: {f.ours:.6g}{unit}"
    if f.theirs is None:
        return f"{text} (only ours; {f.source})"
    word = "as in" if f.agrees else f"unlike {_printed(f.theirs, f.digit)}{unit} of"
    return f"{text}, {word} {f.source}" + (f": {f.remark}" if f.remark else "")


def _printed(value: float, digit: float) -> str:
    """A number, rounded to the known digit."""
    if digit <= 0.0 or value == 0.0:
        return f"{value:.6g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(digit)) + 1
    return f"{value:.{max(1, min(digits, 12))}g}"
