"""Pictures of closed-loop runs: position, voltage, states, phase portrait, comparison.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish; lines also differ in
dash.
"""

from __future__ import annotations

import base64
import io
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.files import write_atomically
from .shown import labelled, shown_unit

if TYPE_CHECKING:
    from ..master.march import LoopRun
    from .closed_loop import ClosedLoopResult

Rows = npt.NDArray[np.int64]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (7, 2)), ":")
STYLE: Any = {
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.titleweight": "bold",
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "svg.hashsalt": "ballscrew",
    "figure.dpi": 110,
}
COLUMNS = 2000  # of a picture: more than twice as many as it has pixels across
MOST_POINTS = 20_000  # of a curve as lines in an SVG; beyond, it is an image inside
MOST = 60_000  # characters of a picture as lines in a page; a longer one is an image
SHADES = 256  # of the colours along a phase portrait
RESTING = 5e-3  # share of a signal's range within which it stays at rest
# margins of a run's pictures, and the room between two rows [in]
_LEFT, _RIGHT, _TOP, _BOTTOM, _BETWEEN = 0.95, 0.2, 0.4, 0.6, 0.2
# name and unit of the signal: its label
_CALLED = {
    ("x", "m"): "position x",
    ("x", "rad"): "angle x",
    ("v", "m/s"): "velocity v",
    ("v", "rad/s"): "angular velocity v",
    ("z", "m"): "bristles z",
    ("i", "A"): "current i",
    ("friction", "N"): "friction",
    ("friction", "N*m"): "friction",
    ("u", "V"): "motor voltage u",
    **{("u", unit): "command u" for unit in ("A", "N", "N*m")},
}
_USUAL = dict(reversed(_CALLED.keys()))  # units if an FMU gives none: the first of each
_STATES = ("x", "v", "z", "i", "friction")
_COLOUR = {"x": 0, "u": 1, "v": 2, "z": 3, "i": 4, "friction": 5}  # in all pictures of a run


def _shown(name: str, *runs: LoopRun) -> tuple[str, float, str]:
    """How a signal of several runs is called, the factor to the displayed unit, and that unit."""
    unit = runs[0].units.get(name, "") or _USUAL.get(name, "")
    values = np.concatenate([_signals(run)[name] for run in runs])
    return _CALLED.get((name, unit), name), *shown_unit(values, unit)


def _signals(run: LoopRun) -> dict[str, Any]:
    return {**run.outputs, **run.commands}


@contextmanager
def drawing(what: str = "a picture") -> Iterator[None]:
    """Let a picture that cannot be drawn, for example with 1e308 V, only print one line.

    Raises OSError if a file cannot be written.
    """
    try:
        yield
    except OSError:
        raise
    except Exception as error:  # Matplotlib raises many kinds of errors for such numbers
        why = " ".join(str(error).split()) or type(error).__name__
        print(f"note: {what} could not be drawn: {why}", file=sys.stderr)


def _as_file(figure: Any, kind: str, **how: Any) -> bytes:
    import matplotlib as mpl

    stream = io.BytesIO()
    with mpl.rc_context(STYLE | how.pop("style", {})):
        figure.savefig(stream, format=kind, **how)
    return stream.getvalue()


@drawing()
def write_figure(figure: Any, folder: Path, stem: str) -> None:
    """Write a figure as PNG and, if ``BALLSCREW_SVG`` is set, as SVG."""
    write_atomically(folder / f"{stem}.png", _as_file(figure, "png"))
    if os.environ.get("BALLSCREW_SVG"):
        write_atomically(folder / f"{stem}.svg", _as_file(figure, "svg", metadata={"Date": None}))


def inline(figure: Any) -> Any:
    """A picture as part of a page: SVG, whose text stays text, or PNG if it has many points."""
    from markupsafe import Markup

    none = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    drawn = _as_file(figure, "svg", metadata=none, style={"svg.fonttype": "none"}).decode()
    if len(drawn) <= MOST:
        drawn = drawn[drawn.index("<svg") :]
        return Markup(re.sub('<g id="[^"]*">', "<g>", drawn))  # a page has each id once
    shown = base64.b64encode(_as_file(figure, "png")).decode()
    return Markup('<img alt="" src="data:image/png;base64,{}">').format(shown)


def in_words(figure: Any, words: Callable[[str], str]) -> Any:
    """The figure with all its text converted by `words`."""
    if words is str:  # nothing to do; ticks would be made before they are drawn
        return figure
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(words(text.get_text()))
    return figure


@cache
def _figure_class() -> Any:
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows without pyplot."""

        def _repr_png_(self) -> bytes:
            return _as_file(self, "png")

    return ShownFigure


def empty_figure(size: tuple[float, float], layout: str | None = None) -> Any:
    """A figure without axes, which is not registered anywhere."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _figure_class()(figsize=size, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def new_figure(
    rows: int, columns: int, size: tuple[float, float], fixed_margins: bool = False
) -> tuple[Any, Any]:
    """A figure with its axes.

    With `fixed_margins` they fit the labels of a run. Else Matplotlib measures all labels, which
    takes longer than drawing them.
    """
    figure = empty_figure(size, layout=None if fixed_margins else "constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    if fixed_margins:
        width, height = size
        each = (height - _TOP - _BOTTOM - (rows - 1) * _BETWEEN) / rows
        figure.subplots_adjust(
            left=_LEFT / width,
            right=1 - _RIGHT / width,
            top=1 - _TOP / height,
            bottom=_BOTTOM / height,
            hspace=_BETWEEN / each,
        )
    return figure, axes


def run_figures(result: ClosedLoopResult) -> dict[str, Any]:
    """Figures of the position, the voltage, the states and the phase plane, by name."""
    import matplotlib as mpl

    run, figures = result.run, {}
    title = f"{result.loop.label}, {run.coupled_by} coupling: {run.verdict.word}"
    if run.alone:
        title = result.loop.label

    def new(name: str, rows: int = 1, size: tuple[float, float] = (8, 4.2)) -> Any:
        figures[name], grid = new_figure(rows, 1, size, fixed_margins=True)
        grid[0][0].set_title(title)
        return grid

    with mpl.rc_context(STYLE):
        if "x" in run.outputs:
            ((axes,),) = new("position")
            _draw_course(axes, run, "x", "position")
            if not run.alone:
                _draw_set_point(axes, run, _shown("x", run)[1], _until_rest(run))
            axes.legend(loc="best")
        if "u" in run.commands:
            ((axes,),) = new("voltage")
            _draw_course(axes, run, "u", "voltage")
            when, highest, label = _peak(run, *_shown("u", run)[1:])
            line = {"arrowstyle": "-", "color": "#555555"}
            where: Any = {"xytext": (25, -6), "textcoords": "offset points"}
            axes.annotate(label, (when, highest), **where, arrowprops=line)
        # the states of an axis, or all outputs if it is no axis
        shown = [n for n in _STATES if n in run.outputs] or list(run.outputs)
        panels = new("states", len(shown), (8, 2.0 * len(shown)))
        for k, n in enumerate(shown):
            _draw_course(panels[k][0], run, n, n)
            if k < len(shown) - 1:
                panels[k][0].set_xlabel("")
                panels[k][0].tick_params(labelbottom=False)
        figures["states"].align_ylabels()
        if {"x", "v"} <= set(run.outputs) and len(run.time) > 2:
            ((axes,),) = new("phase", size=(6.5, 5.2))
            _draw_phase(figures["phase"], axes, run)
    return figures


def _peak(run: LoopRun, factor: float, unit: str) -> tuple[float, float, str]:
    """Time of the largest command, its displayed value and its label."""
    peak = int(np.argmax(np.abs(run.commands["u"])))
    when, highest = run.time[peak], factor * run.commands["u"][peak]
    return when, highest, f"{highest:.1f} {unit} at {when:.3g} s"


def _draw_course(axes: Any, run: LoopRun, name: str, label: str) -> None:
    (called, factor, unit), end = _shown(name, run), _until_rest(run)
    colour = _COLOUR.get(name, list(_signals(run)).index(name))
    _draw(axes, run, _signals(run)[name] * factor, end, COLOURS[colour % len(COLOURS)], label)
    axes.set_xlabel(_time_label(end, run.time[-1]))
    axes.set_ylabel(labelled(called, unit))
    axes.margins(x=0.01)


def _draw_set_point(axes: Any, run: LoopRun, factor: float, end: float) -> None:
    _draw(axes, run, run.reference * factor, end, "#555555", "set-point", lw=1, ls=":")


def _draw(
    axes: Any, run: LoopRun, values: Vector, end: float, colour: str, label: str, **style: Any
) -> None:
    moving = run.time <= end
    shown = rows_over_time(run.time[moving], values[moving])
    axes.plot(run.time[shown], values[shown], color=colour, label=label, **style)


def _time_label(end: float, stop: float) -> str:
    rest = f", at rest from here to {stop:g} s" if end < stop else ""
    return f"time [s]{rest}"


def _until_rest(run: LoopRun) -> float:
    """End of a picture of a run [s]: soon after all signals rest, or the end of the run."""
    last = 0.0
    for values in (*run.outputs.values(), *run.commands.values(), run.reference):
        with np.errstate(over="ignore"):
            away = np.flatnonzero(np.abs(values - values[-1]) > RESTING * np.ptp(values))
        last = max(last, run.time[away[-1]] if len(away) else 0.0)
    return float(1.25 * last if 0.0 < 1.5 * last < run.time[-1] else run.time[-1])


def _draw_phase(figure: Any, axes: Any, run: LoopRun) -> None:
    from matplotlib.collections import LineCollection

    (across, factor, unit), (called, of_v, unit_of_v) = _shown("x", run), _shown("v", run)
    error = run.outputs["x"] - (0.0 if run.alone else run.reference)
    points = np.column_stack([error * factor, run.outputs["v"] * of_v])
    # colours span the motion, not the rest after it
    span = np.maximum(np.ptp(points, axis=0), 1e-12)
    moved = np.cumsum(np.hypot(*(np.diff(points, axis=0) / span).T))
    motion_end = run.time[int(np.searchsorted(moved, 0.999 * moved[-1])) + 1]
    shown = rows_over_plane(points)
    begins = run.time[shown][:-1]
    # one line for each section of one colour
    shade = np.minimum(begins / motion_end * SHADES, SHADES - 1).astype(int)
    strokes = [*pairwise([0, *np.flatnonzero(np.diff(shade)) + 1, len(shade)])]
    lines = LineCollection(
        [points[shown[begin : end + 1]] for begin, end in strokes],
        cmap="viridis",
        linewidths=2.4,
        capstyle="round",
        joinstyle="round",
        rasterized=len(shown) > MOST_POINTS,
    )
    lines.set_array(begins[[begin for begin, _ in strokes]])
    lines.set_clim(0.0, motion_end)
    axes.add_collection(lines)
    axes.autoscale_view()
    axes.plot(*points[0], "o", color=COLOURS[0], label="start")
    axes.plot(*points[-1], "X", color=COLOURS[1], ms=9, label="end")
    axes.set_xlabel(labelled(across if run.alone else "position less set-point", unit))
    axes.set_ylabel(labelled(called, unit_of_v))
    axes.legend(loc="best")
    figure.colorbar(lines, ax=axes, label="time [s]", extend="max")


def comparison_figure(results: Sequence[ClosedLoopResult]) -> Any:
    """A figure of several controllers on the same plant."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, grid = new_figure(3, 1, (9, 9))
        position, fine, voltage = (row[0] for row in grid)
        runs = [result.run for result in results]
        (x, of_x, unit_of_x), (u, of_u, unit_of_u) = _shown("x", *runs), _shown("u", *runs)
        unit = runs[0].units.get("x") or "m"
        finer, least = (1e6, "[µm], 1 nm at least") if unit == "m" else (1.0, f"[{unit}]")
        for k, result in enumerate(results):
            run = result.run
            label = result.loop.label.replace("+", "\n+")  # long names leave no room for curves
            if not result.trusted:
                label += " (not converged)"
            style = {"color": COLOURS[k % len(COLOURS)], "ls": DASHES[k % len(DASHES)]}
            distance = finer * np.maximum(np.abs(run.outputs["x"] - run.reference), 1e-9)
            for axes, values in (
                (position, run.outputs["x"] * of_x),
                (fine, distance),
                (voltage, run.commands["u"] * of_u),
            ):
                shown = rows_over_time(run.time, values)
                name = label if axes is position else "_nolegend_"
                axes.plot(run.time[shown], values[shown], label=name, **style)
            when, highest, label = _peak(run, of_u, unit_of_u)
            voltage.plot(when, highest, "o", color=style["color"], label=label)
        end, stop = max(map(_until_rest, runs)), max(run.time[-1] for run in runs)
        _draw_set_point(position, runs[0], of_x, end)
        position.set_ylabel(labelled(x, unit_of_x))
        position.set_title("Controllers on the same plant")
        fine.set_yscale("log")
        fine.set_ylabel(f"distance to the set-point\n{least}")
        voltage.set_ylabel(labelled(u, unit_of_u))
        voltage.set_xlabel(_time_label(end, stop))
        for axes in (position, fine, voltage):
            axes.set_xlim(-0.02 * end, end)  # changes at the start are separate from the frame
        for axes, title in ((position, ""), (voltage, "peak")):  # next to the curves, never over
            names = axes.get_legend_handles_labels()[1]
            size = 8 if any("\n" in name for name in names) else None
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title=title, fontsize=size)
        figure.align_ylabels()
    return figure


def rows_over_time(time: Vector, values: Vector, columns: int = COLUMNS) -> Rows:
    """Rows of a curve (n,) to draw, in order: the first, last, smallest and largest of each column.

    At most four for each column, and all if there are not more.
    """
    if len(time) <= 4 * columns:
        return np.arange(len(time))
    edges = np.linspace(time[0], time[-1], columns + 1)[1:-1]
    begins = np.unique([0, *np.searchsorted(time, edges), len(time)])
    kept = [
        row
        for begin, end in pairwise(begins)
        for inside in [values[begin:end]]
        for row in (begin, begin + inside.argmin(), begin + inside.argmax(), end - 1)
    ]
    return np.unique(kept)


def rows_over_plane(points: Vector, cells: int = COLUMNS) -> Rows:
    """Rows of a curve (n, 2) to draw: where it enters and leaves cells, and its extremes.

    They are in order; omitted rows are within a cell of the returned ones.
    """
    if len(points) <= 2:
        return np.arange(len(points))
    low = points.min(axis=0)
    span = np.maximum(points.max(axis=0) - low, np.finfo(float).tiny)
    cell = ((points - low) / span * cells).astype(np.int64)
    moved = np.any(cell[1:] != cell[:-1], axis=1)
    kept = np.zeros(len(points), dtype=bool)
    kept[1:] |= moved
    kept[:-1] |= moved
    kept[[0, -1, *points.argmin(axis=0), *points.argmax(axis=0)]] = True
    return np.flatnonzero(kept)
