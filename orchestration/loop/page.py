"""A result as one page of HTML, with its pictures inside; without scripts and network.

Names and units from other people's files are only text in it: the template and Matplotlib escape
them.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from .pictures import STYLE

REPORT = "report.html"
MOST = 60_000  # characters of a picture as lines; a longer one is an image


@dataclass(frozen=True)
class Table:
    """A table of a page; `changed` are the rows whose value is not the default."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    changed: frozenset[int] = frozenset()
    says: str = ""


def page(figures: Mapping[str, Any], **values: Any) -> str:
    """The text of a page.

    Parameters
    ----------
    figures : mapping of str to matplotlib.figure.Figure
    **values
        ``kind`` of the result, ``badge``, ``good`` (whether it is one), ``headline``, ``doubts``,
        ``tables``, and ``made_by``, the command or the function.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader(__package__, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    pictures = {name: _inside(figure) for name, figure in figures.items()}
    return made.get_template("page.html.jinja").render(
        pictures=pictures, version=version("ballscrew"), **values
    )


def _inside(figure: Any) -> Any:
    """A picture as part of a page: SVG, whose text stays text, or PNG if it has many points."""
    import matplotlib as mpl
    from markupsafe import Markup

    lines, image = io.BytesIO(), io.BytesIO()
    none = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context(STYLE | {"svg.fonttype": "none"}):
        figure.savefig(lines, format="svg", metadata=none)
        drawn = lines.getvalue().decode()
        if len(drawn) <= MOST:
            drawn = drawn[drawn.index("<svg") :]
            return Markup(re.sub('<g id="[^"]*">', "<g>", drawn))  # a page has each id once
        figure.savefig(image, format="png")
    shown = base64.b64encode(image.getvalue()).decode()
    return Markup('<img alt="" src="data:image/png;base64,{}">').format(shown)
