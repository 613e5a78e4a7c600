"""Pages that open without a network: one base of HTML, and pictures as plotly's figures.

plotly is used because its zoom and buttons work with mouse, finger and keys; with its script, a
file has 5 MB.

Names and units from other people's files are only text in a page: the templates escape them, and so
do `page` and its script for plotly, which reads texts as HTML.
"""

from __future__ import annotations

import base64
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..solver.files import write_atomically

Vector = npt.NDArray[np.float64]
Figure = dict[str, Any]

REPORT = "report.html"
MOST = 4000  # points of a curve
_HERE = "ballscrew.orchestration"
_LOOKS = {"measured": (5.0, 0.5), "faint": (1.0, 0.4), "dots": (5.0, 0.8)}
_DASHES = {"dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_PLAIN = (1.6, 1.0)  # width [px] and opacity
_BAND = 0.25  # opacity
_LARGEST = float(np.finfo(np.float32).max)
COLOURS_OF_PAGES = 7  # c0 to c6 of the style sheet: those of all pictures


def page(
    package: str | None,
    template: str,
    drawn: Sequence[Figure],
    filters: Mapping[str, Callable[..., Any]] | None = None,
    **values: Any,
) -> str:
    """The text of a page.

    Parameters
    ----------
    package : str
        Package of the template, which extends ``page.html.jinja``.
    drawn : sequence of dict
        As `plotly_figure`, with ``name``, the id of a figure of the template, and ``title``. Curves
        have their colour in ``meta``, by its name in the style sheet.
    filters : mapping of str to function, optional
    **values
        Values for the template.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    made = Environment(
        loader=ChoiceLoader([PackageLoader(package or "", ""), PackageLoader(_HERE, "")]),
        autoescape=True,  # of texts from other people's files
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    made.filters |= filters or {}
    as_text = [f | {"data": _as_text(f["data"]), "layout": _as_text(f["layout"])} for f in drawn]
    return made.get_template(template).render(
        drawn=as_text, plotly=get_plotlyjs(), version=version("ballscrew"), **values
    )


def write_page(folder: Path, text: str) -> None:
    """Write ``report.html``; characters of file names that are not valid text become ``?``.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    write_atomically(folder / REPORT, text.encode("utf-8", "replace"))


def _as_text(value: Any) -> Any:
    """Part of a figure with escaped texts, so that plotly shows them unchanged."""
    if isinstance(value, str):
        return escape(value, quote=False)
    if isinstance(value, dict):
        return {key: _as_text(part) for key, part in value.items()}
    return [_as_text(part) for part in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True)
class Line:
    """A curve of a picture.

    Attributes
    ----------
    style : str
        A colour of the page's style sheet, perhaps with ``faint``, ``dashed``, ``dotted``,
        ``dashdot``, ``dots``, or ``band`` for an area with the curve as its border.
    x, y : ndarray, shape (n,)
        NaN where the curve is interrupted.
    """

    label: str
    style: str
    x: Vector
    y: Vector


@dataclass(frozen=True)
class Picture:
    """Content of one picture.

    Attributes
    ----------
    height : float, optional
        Half the range of y that is shown at first; None: all of it.
    span : tuple of two floats, optional
        The range of y that is shown at first.
    log : bool
        Whether y is logarithmic.
    """

    name: str
    title: str
    says: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    height: float | None = None
    span: tuple[float, float] | None = None
    log: bool = False


def thinned(x: Vector, y: Vector, most: int = MOST) -> tuple[Vector, Vector]:
    """At most `most` points of a curve, with the highest and the lowest of every section.

    Interruptions are kept, with one more point each.
    """
    n = len(x)
    if n <= most:
        return x, y
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    there = np.isfinite(x) & np.isfinite(y)
    high, low = np.where(there, y, -np.inf), np.where(there, y, np.inf)
    keep = set(np.flatnonzero(~there).tolist())
    for a, b in itertools.pairwise(edges.tolist()):
        keep |= {a + int(high[a:b].argmax()), a + int(low[a:b].argmin())}
    places = sorted(keep)
    return x[places], y[places]


def level(label: str, time: Vector, height: float) -> Line:
    ends = np.array([np.nanmin(time), np.nanmax(time)])
    x = np.array([*ends, np.nan, *ends])
    return Line(label, "level dashed", x, height * np.array([1.0, 1.0, np.nan, -1.0, -1.0]))


def plotly_figure(picture: Picture) -> Figure:
    """A picture as plotly's JSON; the page sets the colours, for its light and its dark mode."""
    y_axis: Figure = {"title": {"text": picture.y_label}}
    if picture.log:
        y_axis |= {"type": "log", "exponentformat": "power"}
    if picture.height is not None:
        y_axis["range"] = _range(picture)
    if picture.span is not None:
        y_axis["range"] = list(picture.span)
    return {
        "name": picture.name,
        "title": picture.title,
        "says": picture.says,
        "data": [_trace(line) for line in picture.lines],
        "layout": layout({"title": {"text": picture.x_label}}, y_axis) | {"showlegend": True},
    }


def layout(x: Figure, y: Figure) -> Figure:
    """The layout of a figure with these axes, its legend below."""
    return {
        "xaxis": {"automargin": True, **x},
        "yaxis": {"automargin": True, **y},
        "legend": {"orientation": "h", "yref": "container", "y": 0.0, "yanchor": "bottom"},
        "margin": {"l": 0, "r": 8, "t": 36, "b": 0},
        "separators": ".",  # none between thousands
    }


def _range(picture: Picture) -> list[float]:
    """The range of y shown at first."""
    assert picture.height is not None
    together = np.concatenate([np.zeros(1), *(line.y for line in picture.lines)])
    low, high = float(np.nanmin(together)), float(np.nanmax(together))
    more = 0.05 * (high - low)
    return [max(low - more, -picture.height), min(high + more, picture.height)]


def _trace(line: Line) -> Figure:
    style = line.style.split()
    size, opacity = next((_LOOKS[k] for k in style if k in _LOOKS), _PLAIN)
    x, y = thinned(line.x, line.y)
    trace = {
        "type": "scatter",
        "name": line.label,
        "meta": style[0],
        "opacity": opacity,
        "x": numbers(x),
        "y": numbers(y),
    }
    if "dots" in style:
        return trace | {"mode": "markers", "marker": {"size": size}}
    if "band" in style:
        look = {"mode": "lines", "fill": "toself", "line": {"width": 0}, "hoverinfo": "skip"}
        return trace | look | {"opacity": _BAND}
    dash = next((_DASHES[word] for word in style if word in _DASHES), "solid")
    return trace | {"mode": "lines", "line": {"width": size, "dash": dash}}


def numbers(values: Vector) -> dict[str, str]:
    """Numbers in plotly's binary format, a third of the length of decimals; gaps stay NaN."""
    small = np.clip(values, -_LARGEST, _LARGEST).astype("<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(small.tobytes()).decode()}
