"""What a reader is shown: numbers in suitable units, tables, and a result as one page of HTML.

The page has its pictures inside, and neither scripts nor links to the network. Names and units from
other people's files are only text in it: they are escaped here and by Matplotlib.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from string import Template
from typing import Any

import numpy as np

REPORT = "report.html"
_STEPS = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "µ"), (0.0, 1e9, "n"))
_RAD = 0.1
_PREFIXED = re.compile(r"(?:m|A|rad)(?=$|[/*])")  # mV and mN are no usual units of drives
_PAGE = Template("""\
<!DOCTYPE html>
<html lang="en"><head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
 style-src 'unsafe-inline'; form-action 'none'">
<title>$kind: $headline</title>
<style>
body { max-width: 60rem; margin: 0 auto; padding: 1.5rem; font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.4rem; line-height: 1.3; }
h1, p, li { overflow-wrap: anywhere; }
.badge { display: inline-block; padding: .1rem .7rem; border: 2px solid #0072b2; font-weight: 600; }
.doubt { border-color: #d55e00; }
.weak { color: #a33d00; }
table { border-collapse: collapse; font-size: .9375rem; }
th, td { text-align: left; padding: .25rem 1.1rem .25rem 0; vertical-align: top;
 border-bottom: 1px solid #d8d8d4; font-variant-numeric: tabular-nums; }
tbody th { font-weight: 500; }
.changed th, .changed td { font-weight: 700; }
figure { margin: 1.5rem 0; }
figure svg, figure img { max-width: 100%; height: auto; }
.wide { overflow-x: auto; }
</style>
</head><body>
<p class="badge $style">$badge</p>
<h1>$headline</h1>
$body
<footer>Made by <code>$made_by</code>, ballscrew $version.</footer>
</body></html>
""")


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


def page(
    pictures: Mapping[str, str], doubts: Sequence[str], tables: Sequence[Table], **texts: str
) -> str:
    """The text of a page with pictures of `pictures.inline`.

    `texts` are the ``kind`` of the result, ``badge``, its ``style``, ``headline``, and ``made_by``,
    the command or the function.
    """
    weak = f"<p>What weakens this:</p>\n<ul>{_each('li class=weak', doubts)}</ul>"
    body = [weak] if doubts else []
    body += [f'<figure id="{n}">{drawn}</figure>' for n, drawn in pictures.items()]
    body += map(_as_html, tables)
    safe = {n: escape(t) for n, t in {**texts, "version": version("ballscrew")}.items()}
    return _PAGE.substitute(safe, body="\n".join(body))


def _each(tag: str, texts: Iterable[str]) -> str:
    """Texts within tags, in which they are only text."""
    return "".join(f"<{tag}>{escape(str(text))}</{tag.split()[0]}>" for text in texts)


def _as_html(table: Table) -> str:
    rows = "\n".join(
        f"<tr{' class=changed' * (k in table.changed)}>{_each('th scope=row', row[:1])}"
        f"{_each('td', row[1:])}</tr>"
        for k, row in enumerate(table.rows)
    )
    return (
        f"<section>{_each('h2', [table.title])}{_each('p', filter(None, [table.says]))}"
        f"<div class=wide><table><thead><tr>{_each('th scope=col', table.columns)}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody></table></div></section>"
    )
