"""Pictures of closed-loop runs: signals over time, phase portrait, comparison.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish; lines also differ in
dash.
"""

from __future__ import annotations

import base64
import io
import math
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...solver.arrays import Vector
from ...solver.files import write_atomically
from .shown import labelled, shown_unit

if TYPE_CHECKING:
    from ..master.march import LoopRun
    from .closed_loop import ClosedLoopResult

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (7, 2)), ":")
STYLE: Any = {
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "font.size": 11,
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # else Matplotlib seeks a place above all ticks, which takes long
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "svg.hashsalt": "ballscrew",
    "figure.dpi": 110,
}
POINTS = 20_000  # of a phase portrait: Matplotlib thins out curves over time only
MOST = 60_000  # characters of a picture as lines in a page; a longer one is an image
RESTING = 5e-3  # share of a signal's range within which it stays at rest
# signals of an axis: what they are called, and their unit if an FMU gives none
_CALLED = {
    "x": ("position", "m"),
    "u": ("command", "V"),
    "v": ("velocity", "m/s"),
    "z": ("bristles", "m"),
    "i": ("current", "A"),
    "friction": ("friction", "N"),
}


def _shown(name: str, *runs: LoopRun) -> tuple[str, float, str]:
    """How a signal of several runs is called, the factor to the displayed unit, and that unit."""
    called, usual = _CALLED.get(name, ("", ""))
    unit = runs[0].units.get(name, "") or usual
    values = np.concatenate([{**run.outputs, **run.commands}[name] for run in runs])
    label = name if called in ("", name) else f"{called} {name}"
    return label, *shown_unit(values, unit)


@contextmanager
def drawing(what: str = "a picture") -> Iterator[None]:
    """Let a picture that cannot be drawn, for example with 1e308 V, only print one line."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:  # Matplotlib raises many kinds of errors for such numbers
        why = " ".join(str(error).split()) or type(error).__name__
        print(f"note: {what} could not be drawn: {why}", file=sys.stderr)


def _as_file(figure: Any, kind: str, for_good: bool = False, **how: Any) -> bytes:
    """A figure as bytes; if `for_good`, places are found once, which takes longer than the rest."""
    import matplotlib as mpl

    stream = io.BytesIO()
    with mpl.rc_context(STYLE | how.pop("style", {})):
        if for_good and (layout := figure.get_layout_engine()):
            layout.execute(figure)
            figure.set_layout_engine(None)  # with "none", each file would be drawn twice
        figure.savefig(stream, format=kind, **how)
    for axes in figure.axes if for_good else ():
        for axis in (axes.xaxis, axes.yaxis):
            place = axis.label.get_transform().transform(axis.label.get_position())
            axis.set_label_coords(*axes.transAxes.inverted().transform(place))
    return stream.getvalue()


@drawing()
def write_figure(figure: Any, folder: Path, stem: str) -> None:
    """Write a figure as PNG and, if ``BALLSCREW_SVG`` is set, as SVG."""
    figure.png = _as_file(figure, "png", for_good=True)
    write_atomically(folder / f"{stem}.png", figure.png)
    if os.environ.get("BALLSCREW_SVG"):
        write_atomically(folder / f"{stem}.svg", _as_file(figure, "svg", metadata={"Date": None}))


def inline(figure: Any) -> str:
    """A picture as part of a page: SVG, whose text stays text, or PNG if it has many points."""
    none = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    drawn = _as_file(figure, "svg", metadata=none, style={"svg.fonttype": "none"}).decode()
    if len(drawn) <= MOST:
        return re.sub('<g id="[^"]*">', "<g>", drawn[drawn.index("<svg") :])  # each id once
    shown = base64.b64encode(getattr(figure, "png", None) or _as_file(figure, "png")).decode()
    return f'<img alt="" src="data:image/png;base64,{shown}">'


def new_figure(
    rows: int, columns: int, size: Any, layout: Any = "constrained", sharex: bool = False
) -> tuple[Any, Any]:
    """A figure that is registered nowhere, and its axes; `size` is in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=size, layout=layout)
    FigureCanvasAgg(figure)
    figure._repr_png_ = partial(_as_file, figure, "png")
    return figure, figure.subplots(rows, columns, sharex=sharex, squeeze=False)


@contextmanager
def styled_figure(*shape: Any, **style: Any) -> Iterator[tuple[Any, Any]]:
    """As `new_figure`, to draw in the common style."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE | style):
        yield new_figure(*shape)


def run_figures(result: ClosedLoopResult) -> dict[str, Any]:
    """Figures of the signals over time and of the phase plane, by name."""
    run, figures = result.run, {}
    coupled = f"{result.loop.label}, {run.coupled_by} coupling: {run.verdict.word}"
    title = result.loop.label if run.alone else coupled
    if run.outputs or run.commands:
        figures["signals"] = _signals(run, title)
    if {"x", "v"} <= set(run.outputs) and len(run.time) > 2:
        with styled_figure(1, 1, (6.5, 5.2), None) as (figures["phase"], ((axes,),)):
            axes.set_title(title)
            _draw_phase(axes, run)
    return figures


def _signals(run: LoopRun, title: str) -> Any:
    """The signals of an axis over time, or all if it is no axis, one above the other."""
    known, end = {**run.outputs, **run.commands}, _until_rest(run)
    is_axis = any(name in _CALLED for name in run.outputs)
    names = [n for n in _CALLED if n in known] if is_axis else list(known)
    height = 1.9 * len(names) + 1.0
    with styled_figure(len(names), 1, (8, height), None) as (figure, grid):
        figure.subplots_adjust(top=1 - 0.4 / height, bottom=0.6 / height)
        for k, (axes, name) in enumerate(zip(grid.flat, names, strict=True)):
            called, factor, unit = _shown(name, run)
            style = {"color": COLOURS[k % len(COLOURS)], "label": called}
            _draw(axes, run, known[name] * factor, end, **style)
            axes.set_xlabel(_time_label(end, run.time[-1]))
            axes.set_ylabel(labelled(called, unit))
            axes.margins(x=0.01)
            axes.label_outer()
            if name == "x" and not run.alone:
                _draw_set_point(axes, run, factor, end)
                axes.legend(loc="best")
        grid[0][0].set_title(title)
        figure.align_ylabels()
    return figure


def _draw(axes: Any, run: LoopRun, values: Vector, end: float = math.inf, **style: Any) -> None:
    moving = run.time <= end
    axes.plot(run.time[moving], values[moving], **style)


def _draw_set_point(axes: Any, run: LoopRun, factor: float, end: float) -> None:
    _draw(axes, run, run.reference * factor, end, color="#555555", label="set-point", lw=1, ls=":")


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


def _draw_phase(axes: Any, run: LoopRun) -> None:
    (across, factor, unit), (called, of_v, unit_of_v) = _shown("x", run), _shown("v", run)
    error = run.outputs["x"] - (0.0 if run.alone else run.reference)
    x, v = error * factor, run.outputs["v"] * of_v
    every = 1 + len(x) // POINTS
    axes.plot(x[::every], v[::every], color=COLOURS[0])
    axes.plot(x[0], v[0], "o", color=COLOURS[2], label="start")
    axes.plot(x[-1], v[-1], "X", color=COLOURS[1], ms=9, label="end")
    axes.set_xlabel(labelled(across if run.alone else "position less set-point", unit))
    axes.set_ylabel(labelled(called, unit_of_v))
    axes.legend(loc="best")


def comparison_figure(results: Sequence[ClosedLoopResult]) -> Any:
    """A figure of several controllers on the same plant."""
    with styled_figure(3, 1, (9, 9), None) as (figure, grid):
        position, fine, voltage = grid[:, 0]
        runs = [result.run for result in results]
        (x, of_x, unit_of_x), (u, of_u, unit_of_u) = _shown("x", *runs), _shown("u", *runs)
        unit = runs[0].units.get("x") or "m"
        finer, least = (1e6, "[µm], 1 nm at least") if unit == "m" else (1.0, f"[{unit}]")
        for k, (result, run) in enumerate(zip(results, runs, strict=True)):
            label = result.loop.label.replace("+", "\n+")  # long names leave no room for curves
            label += "" if result.trusted else " (not converged)"
            style = {"color": COLOURS[k % len(COLOURS)], "ls": DASHES[k % len(DASHES)]}
            distance = np.maximum(np.abs(run.outputs["x"] - run.reference), 1e-9)
            _draw(position, run, run.outputs["x"] * of_x, label=label, **style)
            _draw(fine, run, finer * distance, **style)
            _draw(voltage, run, run.commands["u"] * of_u, **style)
            peak = int(np.argmax(np.abs(run.commands["u"])))
            when, highest = run.time[peak], of_u * run.commands["u"][peak]
            label = f"{highest:.1f} {unit_of_u} at {when:.3g} s"
            voltage.plot(when, highest, "o", color=style["color"], label=label)
        end, stop = max(map(_until_rest, runs)), max(run.time[-1] for run in runs)
        _draw_set_point(position, runs[0], of_x, end)
        position.set_ylabel(labelled(x, unit_of_x))
        position.set_title("Controllers on the same plant")
        fine.set_yscale("log")
        fine.yaxis.set_major_formatter("{x:g}")  # not as a formula, which takes long
        if fine.get_ylim()[1] > 1e3 * fine.get_ylim()[0]:  # three ticks or more
            fine.minorticks_off()
        fine.set_ylabel(f"distance to the set-point\n{least}")
        voltage.set_ylabel(labelled(u, unit_of_u))
        voltage.set_xlabel(_time_label(end, stop))
        for axes in (position, fine, voltage):
            axes.set_xlim(-0.02 * end, end)  # changes at the start are separate from the frame
        for axes, title in ((position, ""), (voltage, "peak")):  # next to the curves, never over
            size = 8 if any("\n" in name for name in axes.get_legend_handles_labels()[1]) else None
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title=title, fontsize=size)
        names = max(axes.get_legend().get_window_extent().width for axes in (position, voltage))
        right = max(0.99 - names / figure.bbox.width, 0.3)
        figure.subplots_adjust(left=0.13, right=right, bottom=0.06, top=0.96, hspace=0.15)
        figure.align_ylabels()
    return figure
