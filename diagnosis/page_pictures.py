"""Pictures of the report's page as SVG within HTML, which a browser can zoom."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

MOST = 4000  # points of a curve
UNITS = 1000.0  # width and height of a drawing
_WIDTH, _HEIGHT = 900, 330
_LEFT, _TOP, _RIGHT, _BOTTOM = 78, 10, 14, 52
_TICKS = {"x": 9, "y": 6}


@dataclass(frozen=True)
class Line:
    """A curve of a picture.

    Attributes
    ----------
    style : str
        Classes of the page's style sheet: a colour, perhaps ``faint`` or ``dashed``.
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


def drawn(picture: Picture) -> str:
    """A picture as SVG within HTML, with its title and its legend."""
    dots = any("dots" in line.style for line in picture.lines)
    x0, x1 = _range([line.x for line in picture.lines], 0.02 if dots else 0.0)
    y0, y1 = _range([*(line.y for line in picture.lines), np.zeros(1)], 0.05)
    low, high = y0, y1
    if picture.height is not None:
        low, high = max(y0, -picture.height), min(y1, picture.height)
    view = [0.0, UNITS * (y1 - high) / (y1 - y0), UNITS, UNITS * (high - low) / (y1 - y0)]
    paths = "\n".join(
        f'<path class="{line.style}" d="{_path(line, x0, x1, y0, y1)}"/>' for line in picture.lines
    )
    legend = "".join(
        f'<span><svg class="key" viewBox="0 0 26 8"><path class="{line.style}" d="{_key(line)}"/>'
        f"</svg>{escape(line.label)}</span>"
        for line in picture.lines
    )
    title = escape(picture.title)
    inside = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    box = " ".join(f"{v:.6g}" for v in view)
    return f"""<figure id="{picture.name}">
<h3>{title}</h3>
<figcaption>{escape(picture.says)}</figcaption>
<div class="legend">{legend}</div>
<svg class="picture" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{title}">
<g class="ticks">{_ticks(x0, x1, low, high, inside)}</g>
<svg class="plot" x="{_LEFT}" y="{_TOP}" width="{inside[0]}" height="{inside[1]}" viewBox="{box}"
 preserveAspectRatio="none" data-range="{x0!r} {x1!r} {y0!r} {y1!r}">
<rect class="paper" width="{UNITS:g}" height="{UNITS:g}"/>
{paths}
</svg>
<text class="label" x="{_LEFT + inside[0] / 2:g}" y="{_HEIGHT - 8}">{escape(picture.x_label)}</text>
<text class="label" transform="translate(16 {_TOP + inside[1] / 2:g}) rotate(-90)"
>{escape(picture.y_label)}</text>
</svg>
</figure>"""


def _key(line: Line) -> str:
    return "M13 4h0" if "dots" in line.style else "M1 4H25"


def _range(values: Sequence[Vector], margin: float) -> tuple[float, float]:
    together = np.concatenate(values)
    together = together[np.isfinite(together)]
    if not len(together):
        return 0.0, 1.0
    low, high = float(together.min()), float(together.max())
    if high - low < 1e-9 * max(abs(low), abs(high)) or high == low:
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    more = margin * (high - low)
    return low - more, high + more


def _path(line: Line, x0: float, x1: float, y0: float, y1: float) -> str:
    x, y = thinned(line.x, line.y)
    across, down = UNITS * (x - x0) / (x1 - x0), UNITS * (y1 - y) / (y1 - y0)
    points = zip(across.tolist(), down.tolist(), strict=True)
    if "dots" in line.style:
        return "".join(f"M{a:.2f} {b:.2f}h0" for a, b in points if math.isfinite(a + b))
    steps, pen = [], "M"
    for a, b in points:
        if math.isfinite(a + b):
            steps.append(f"{pen}{a:.2f} {b:.2f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(steps)


def _ticks(x0: float, x1: float, y0: float, y1: float, inside: tuple[int, int]) -> str:
    """Grid and numbers as the page's script draws them after a zoom, for a page without scripts."""
    parts = []
    for value, text in _round_numbers(x0, x1, _TICKS["x"]):
        at = _LEFT + inside[0] * (value - x0) / (x1 - x0)
        parts.append(
            f'<path d="M{at:.1f} {_TOP}V{_TOP + inside[1]}"/>'
            f'<text class="x" x="{at:.1f}" y="{_TOP + inside[1] + 17}">{text}</text>'
        )
    for value, text in _round_numbers(y0, y1, _TICKS["y"]):
        at = _TOP + inside[1] * (y1 - value) / (y1 - y0)
        parts.append(
            f'<path d="M{_LEFT} {at:.1f}H{_LEFT + inside[0]}"/>'
            f'<text class="y" x="{_LEFT - 7}" y="{at + 4:.1f}">{text}</text>'
        )
    return "".join(parts)


def _round_numbers(low: float, high: float, most: int) -> list[tuple[float, str]]:
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(f * power for f in (1, 2, 5, 10) if f * power >= raw * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(k * step, f"{k * step:.{digits}f}") for k in range(first, last + 1)]
