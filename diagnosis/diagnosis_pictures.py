"""Pictures of a diagnosis: for its page, drawn so that a browser can zoom them, and for papers.

In the page a picture is a frame with ticks around a drawing of 1000 by 1000 units, whose view is
what zooming changes; lines keep their width, and the ticks are drawn anew.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.pictures import COLOURS, STYLE, new_figure, write_figure
from .closed_loop_effect import SETPOINT, ClosedLoopEffect
from .diagnosis import Curves, Diagnosis

Vector = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MOST = 4000  # points of a curve
UNITS = 1000.0  # width and height of a drawing
SMOOTH = 0.1  # time over which a force residual is averaged to be shown [s]
MENDED = "mended"
_BINS = 60
_LEAST_IN_BIN = 20
_SHOWN = 0.995  # of the samples of a curve within a picture's height, at first
_MEANS_SHOWN = 0.95
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


def smoothed(values: Vector, record: npt.NDArray[np.int64], step: float) -> Vector:
    """Moving mean over `SMOOTH` within each record."""
    width = max(1, round(SMOOTH / step))
    out = np.empty(len(values))
    for k in np.unique(record):
        here = np.flatnonzero(record == k)
        kernel = np.ones(min(width, len(here)))
        total = np.convolve(values[here], kernel, "same")
        out[here] = total / np.convolve(np.ones(len(here)), kernel, "same")
    return out


def binned(x: Vector, y: Vector, keep: Mask, alike: bool = False) -> tuple[Vector, Vector]:
    """Means of y over parts of the range of x, NaN where there is next to nothing.

    The parts are even, or have as many samples each: where `alike`, as for speeds that were held.
    """
    if not np.any(keep) or np.ptp(x[keep]) == 0:
        return np.array([np.nan]), np.array([np.nan])
    if alike:
        order = np.flatnonzero(keep)[np.argsort(x[keep], kind="stable")]
        parts = np.array_split(order, min(2 * _BINS, max(1, len(order) // _LEAST_IN_BIN)))
        return np.array([x[k].mean() for k in parts]), np.array([y[k].mean() for k in parts])
    edges = np.linspace(x[keep].min(), x[keep].max(), _BINS + 1)
    place = np.clip(np.digitize(x[keep], edges) - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    total = np.bincount(place, weights=y[keep], minlength=_BINS)
    mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean


def end_to_end(curves: Curves) -> Vector:
    """Time of records one after the other [s]; NaN at the last sample of each but one."""
    time = np.array(curves.time, dtype=float)
    ends = np.flatnonzero(np.diff(curves.record)) + 1
    for k in ends:
        time[k:] += time[k - 1] + (time[k - 1] - time[k - 2]) - time[k]
    time[ends - 1] = np.nan
    return time


def pictures_of(diagnosis: Diagnosis) -> list[Picture]:
    """What the page shows of the records."""
    c = diagnosis.curves
    time = end_to_end(c)
    step = float(np.median(np.diff(c.time)))
    floor = diagnosis.floor
    mended = "with all that was found" if diagnosis.unnamed else MENDED
    before, after = (smoothed(v, c.record, step) for v in (c.before, c.after))
    ways = {"forwards": c.telling & (c.v > 0), "backwards": c.telling & (c.v < 0)}
    along = [
        Line(f"{label}, {way}", style, 1e3 * x, y)
        for label, colour, values in (
            ("as believed", "before", c.before),
            (mended, "after", c.after),
        )
        for way, style in (("forwards", colour), ("backwards", f"{colour} dashed"))
        for x, y in (binned(c.x, values, ways[way]),)
    ]
    speed = [
        Line(label, f"{style} dots", 1e3 * x, y)
        for label, style, values in (
            ("as believed", "before", c.before),
            (mended, "after", c.after),
        )
        for x, y in (binned(c.v, values, c.telling, alike=True),)
    ]
    x_time = "time [s]"
    largest = float(np.abs(c.position_before).max())
    factor, unit = (1e3, "mm") if largest >= 1e-3 else (1e6, "µm")
    named = []
    if np.any(c.cause) or not np.any(c.shape):
        named.append(Line("named causes", "cause", time, c.cause))
    if np.any(c.shape):
        named.append(Line("without a name", "shape", time, c.shape))
    return [
        Picture(
            "force",
            "Force: measured and predicted",
            "Friction and all else that opposes the motion, as the record asks for it and as each "
            "model has it.",
            x_time,
            "force [N]",
            (
                Line("measured", "measured", time, c.force),
                Line("believed model", "before", time, c.predicted),
                Line(
                    f"{mended} model" if mended == MENDED else mended,
                    "after",
                    time,
                    c.force - c.after,
                ),
            ),
        ),
        Picture(
            "residual_time",
            "Force residual over time",
            f"Means over {SMOOTH:g} s; pale: every sample. Noise alone is {floor.force:.3g} N rms.",
            x_time,
            "residual [N]",
            (
                Line(f"every sample, {mended}", "after faint", time, c.after),
                Line("as believed", "before", time, before),
                Line(mended, "after", time, after),
            ),
            _height(np.concatenate([before, after]), _SHOWN),
        ),
        Picture(
            "residual_position",
            "Force residual over position, by direction",
            "Means over parts of the travel. Friction changes sign with the direction, a load does "
            "not.",
            "position [mm]",
            "mean residual [N]",
            tuple(along),
            _height(np.concatenate([line.y for line in along]), _MEANS_SHOWN),
        ),
        Picture(
            "residual_velocity",
            "Force residual over velocity",
            "Means over neighbouring speeds, as many samples each.",
            "velocity [mm/s]",
            "mean residual [N]",
            tuple(speed),
        ),
        Picture(
            "position_residual",
            "Position residual over time",
            "By how much a position foretold from the start of each second is wrong.",
            x_time,
            f"residual [{unit}]",
            (
                Line("as believed", "before", time, factor * c.position_before),
                Line(mended, "after", time, factor * c.position_after),
                _level("noise alone, rms", time, factor * floor.position),
            ),
        ),
        Picture(
            "causes",
            "Force of the causes",
            "What the named causes add to the model, and what is left without a name.",
            x_time,
            "force [N]",
            tuple(named),
        ),
    ]


def pictures_of_loop(effect: ClosedLoopEffect) -> list[Picture]:
    """What the page shows of the closed loop."""
    time, milli = effect.time, 1e3
    return [
        Picture(
            "loop",
            "Closed loop: position error",
            "Distance to the set-point, for the plant as believed and with the causes.",
            "time [s]",
            "error [mm]",
            (
                Line("believed plant", "before", time, milli * (effect.believed.x - SETPOINT)),
                Line(
                    "extended plant", "after dashed", time, milli * (effect.extended.x - SETPOINT)
                ),
            ),
        ),
        Picture(
            "loop_difference",
            "Closed loop: what the causes change",
            "Position of the extended plant less that of the believed one.",
            "time [s]",
            "difference [µm]",
            (Line("difference", "cause", time, 1e6 * (effect.extended.x - effect.believed.x)),),
        ),
    ]


def _height(values: Vector, share: float) -> float | None:
    """What shows so many of the values, and keeps a few that are far off from hiding the rest."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.5 * float(np.quantile(finite, share)) or None if len(finite) else None


def _level(label: str, time: Vector, height: float) -> Line:
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


def save_pictures(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.png: the residual before and after, in force and position.

    Raises
    ------
    OSError
        If they cannot be written.
    """
    import matplotlib as mpl

    c = diagnosis.curves
    time = end_to_end(c)
    step = float(np.median(np.diff(c.time)))
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(2, 1, (9, 6))
        force, position = grid[0][0], grid[1][0]
        for values, colour, dash, label in (
            (c.before, COLOURS[1], "-", "as believed"),
            (c.after, COLOURS[0], "--", "mended"),
        ):
            _plot(force, time, smoothed(values, c.record, step), colour, dash, label)
        for values, colour, dash, label in (
            (c.position_before, COLOURS[1], "-", "as believed"),
            (c.position_after, COLOURS[0], "--", "mended"),
        ):
            _plot(position, time, 1e6 * values, colour, dash, label)
        force.set_title(f"Residual before and after: {diagnosis.verdict}", loc="left")
        force.set_ylabel(f"force, means over {SMOOTH:g} s [N]")
        position.set_ylabel("position after up to 1 s [µm]")
        position.set_xlabel("time [s]")
        for axes in (force, position):
            axes.margins(x=0.01)
        force.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        figure.align_ylabels()
        write_figure(figure, folder, "diagnosis")


def _plot(axes: Any, time: Vector, values: Vector, colour: str, dash: str, label: str) -> None:
    axes.plot(*thinned(time, values), color=colour, ls=dash, lw=1.2, label=label)
