"""What all systems share: numbers with their source, and motions of a whole loop in one solver."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import ballscrew

Values = Mapping[str, float]


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


def motion(
    plant: str,
    stop: float,
    step: float,
    values: Values | None = None,
    law: str = "none",
    goal: float | None = None,
    gains: Values | None = None,
) -> Any:
    """A run with these values of the plant and of the law; `goal` is the set-point."""
    return _run(plant, stop, step, _frozen(values), law, goal, _frozen(gains))


@cache
def _run(plant: str, stop: float, step: float, values: Any, law: str, goal: Any, gains: Any) -> Any:
    given: dict[str, Any] = {"plant_values": dict(values), "controller_values": dict(gains)}
    grid: dict[str, Any] = {"stop": stop, "step": step, "fmus": False}
    return ballscrew.run(law, plant, reference=goal, **grid, **given).run


def exponents(
    plant: str,
    stop: float,
    values: Values | None = None,
    law: str = "none",
    goal: float | None = None,
    gains: Values | None = None,
) -> Any:
    """Exponents and long-term motion (``.motion``) of a loop."""
    return _exponents(plant, stop, _frozen(values), law, goal, _frozen(gains))


@cache
def _exponents(plant: str, stop: float, values: Any, law: str, goal: Any, gains: Any) -> Any:
    given: dict[str, Any] = {"plant_values": dict(values), "controller_values": dict(gains)}
    return ballscrew.lyapunov(law, plant, stop=stop, reference=goal, **given)


def _frozen(values: Values | None) -> tuple[tuple[str, float], ...]:
    return tuple(sorted((values or {}).items()))


def cells(
    plant: str,
    x: str,
    y: str,
    stop: float,
    law: str = "none",
    goal: float | None = None,
    **more: Any,
) -> dict[str, list[Any]]:
    """The table of a map by column; `more` as `stability_map`."""
    with tempfile.TemporaryDirectory() as folder:
        found = ballscrew.stability_map(
            law, x, y, folder, plant=plant, stop=stop, reference=goal, **more
        )
        return found.columns()


def halved(holds: Callable[[float], bool], low: float, high: float, width: float) -> list[float]:
    """An interval of at most this width at whose lower end `holds` is true, at the upper false."""
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return [low, high]
