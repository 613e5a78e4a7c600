"""A number of a system, ours beside the literature's."""

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
        What it is, with the parameters that it belongs to.
    ours : float
        As computed here.
    unit : str
        SI; "1" for none.
    source : str
        Where `theirs` is printed or follows from; of a number that only we have, how it is checked.
    theirs : float or None
        The literature's.
    digit : float
        One unit of the last digit of `theirs`, as it is printed there, or what a formula leaves
        out.
    remark : str
        Why the two differ.
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
        """Whether the two are the same within one digit; None where only we have it."""
        return None if self.theirs is None else bool(abs(self.ours - self.theirs) <= self.digit)


def table_of(findings: Sequence[Finding]) -> str:
    """The findings as a table of Markdown."""
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
        If it has no place for one.
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
    """A number to the digit that is known of it."""
    if digit <= 0.0 or value == 0.0:
        return f"{value:.6g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(digit)) + 1
    return f"{value:.{max(1, min(digits, 12))}g}"
