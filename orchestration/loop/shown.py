"""What a reader is shown: numbers in suitable units, tables, and a result as one page of HTML.

The page has its pictures inside, and neither scripts nor links to the network. Names and units from
other people's files are only text in it: the template and Matplotlib escape them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

REPORT = "report.html"
_STEPS = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "µ"), (0.0, 1e9, "n"))
_RAD = 0.1
_PREFIXED = re.compile(r"(?:m|A|rad)(?=$|[/*])")  # mV and mN are no usual units of drives


def shown_unit(values: Iterable[float] | Any, unit: str) -> tuple[float, str]:
    """The factor from a unit to the one that suits the largest of some values, and that unit.

    Values that are not finite are ignored; "1" means no unit.

    >>> shown_unit([0.02, -0.08], "m"), shown_unit([3e-6], "m/s"), shown_unit([0.0], "m")
    ((1000.0, 'mm'), (1000000.0, 'µm/s'), (1.0, 'm'))
    """
    sizes = np.abs(np.asarray(values, dtype=float))
    largest = float(np.max(sizes, initial=0.0, where=np.isfinite(sizes)))
    whole = unit.startswith("rad") and largest >= _RAD  # 0.5 rad is no 500 mrad
    if not _PREFIXED.match(unit) or largest == 0.0 or whole:
        return 1.0, "" if unit == "1" else unit
    factor, prefix = next((f, p) for least, f, p in _STEPS if largest >= least)
    return factor, prefix + unit


def quantity(value: float | None, unit: str, digits: int = 6) -> str:
    """A number with some digits in the unit that suits it; a dash if there is none."""
    if value is None:
        return "-"
    factor, shown = shown_unit([value], unit)
    return f"{factor * value:.{digits}g} {shown}".rstrip()


def length(value: float) -> str:
    """A length [m] with three digits."""
    return quantity(value, "m", 3)


def labelled(name: str, unit: str) -> str:
    """The label of an axis."""
    return f"{name} [{unit}]" if unit else name


@dataclass(frozen=True)
class Table:
    """A table of a page; `changed` are the rows whose value is not the default."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    changed: frozenset[int] = frozenset()
    says: str = ""


def page(pictures: Mapping[str, Any], **values: Any) -> str:
    """The text of a page with pictures of `pictures.inline`.

    `values` are the ``kind`` of the result, ``badge``, ``good`` (whether it is one), ``headline``,
    ``doubts``, ``tables``, and ``made_by``, the command or the function.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(__package__, "")
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = made.get_template("page.html.jinja")
    return template.render(pictures=pictures, version=version("ballscrew"), **values)
