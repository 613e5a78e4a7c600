"""The HTML page inside an FMU: its equations, parameters and ports."""

from __future__ import annotations

import math
from html import escape

from ..solver.kernel import Kernel
from .interface import Interface

_STYLE = """
body { font-family: sans-serif; max-width: 60rem; margin: 2rem auto; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 }
td, th { border: 1px solid #bbb; padding: .25rem .6rem; text-align: left; vertical-align: top }
mtd { text-align: left }
p.equation { margin: .6rem 0 .6rem 2rem; text-indent: -2rem; font-size: 1.1rem }
"""


def html_page(kernel: Kernel, interface: Interface) -> str:
    """The page as text; equations are MathML, which browsers show without a script.

    Each term of a sum is an element of its own, between which a line may end.
    """
    equations = "\n".join(
        f'<p class="equation"><math>{left}</math> <math><mo>=</mo>{first}</math>'
        + "".join(f" <math>{term}</math>" for term in more)
        + "</p>"
        for left, first, *more in kernel.equations
    )
    rows = {
        causality: "\n".join(
            _row(v.name, v.unit, v.start, v.minimum, v.maximum, v.description)
            for v in interface.variables
            if v.causality == causality
        )
        for causality in ("input", "output", "parameter")
    }
    head = "<tr><th>name</th><th>unit</th><th>default</th><th>range</th><th>meaning</th></tr>"
    tables = "\n".join(
        f"<h2>{title}</h2>\n<table>{head}\n{rows[causality]}\n</table>"
        for title, causality in (
            ("Inputs", "input"),
            ("Outputs", "output"),
            ("Parameters", "parameter"),
        )
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(kernel.name)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape(kernel.name)}</h1>\n<p>{escape(kernel.description)}.</p>\n"
        f"<h2>Equations</h2>\n{equations}\n{tables}\n</body></html>\n"
    )


def _row(
    name: str, unit: str, start: float | None, low: float, high: float, description: str
) -> str:
    limits = "" if math.isinf(low) and math.isinf(high) else f"{low:g} to {high:g}"
    default = "" if start is None else repr(start)
    cells = (name, unit, default, limits, description)
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
