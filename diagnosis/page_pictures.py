"""Pictures of the report's page as plotly's figures.

plotly, as its zoom and buttons work with mouse, finger and keys; a file is 5 MB with its script.
"""

from __future__ import annotations

import base64
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Figure = dict[str, Any]

MOST = 4000  # points of a curve
_LOOKS = {"measured": (5.0, 0.5), "faint": (1.0, 0.4), "dots": (5.0, 0.8)}
_PLAIN = (1.6, 1.0)  # width [px] and opacity


@dataclass(frozen=True)
class Line:
    """A curve of a picture.

    Attributes
    ----------
    style : str
        A colour of the page's style sheet, perhaps with ``faint``, ``dashed`` or ``dots``.
    x, y : ndarray, shape (n,)
        NaN where the curve is interrupted.
    """

    label: str
    style: str
    x: Vector
    y: Vector


@dataclass(frozen=True)
class Picture:
    """What one picture shows; `height` is half the range of y shown at first, None for all."""

    name: str
    title: str
    says: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    height: float | None = None


def thinned(x: Vector, y: Vector, most: int = MOST) -> tuple[Vector, Vector]:
    """At most so many points of a curve, the highest and the lowest of every stretch kept.

    Where it is interrupted it stays so, with a point more each time.
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
    """A picture as plotly's JSON; the page has the colours, as they follow light and dark."""
    y_axis: Figure = {"title": {"text": picture.y_label}, "automargin": True}
    if picture.height is not None:
        y_axis["range"] = _range(picture)
    return {
        "data": [_trace(line) for line in picture.lines],
        "layout": {
            "xaxis": {"title": {"text": picture.x_label}, "automargin": True},
            "yaxis": y_axis,
            "showlegend": True,
            "legend": {"orientation": "h", "yref": "container", "y": 0.0, "yanchor": "bottom"},
            "margin": {"l": 0, "r": 8, "t": 36, "b": 0},
        },
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
        "x": _numbers(x),
        "y": _numbers(y),
    }
    if "dots" in style:
        return trace | {"mode": "markers", "marker": {"size": size}}
    dash = "dash" if "dashed" in style else "solid"
    return trace | {"mode": "lines", "line": {"width": size, "dash": dash}}


def _numbers(values: Vector) -> dict[str, str]:
    """As plotly reads them, in a third of the characters of decimals; gaps stay NaN."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}
