"""Pictures of closed-loop runs: position, voltage, states, phase portrait, comparison.

Colours are Okabe and Ito's, which the colour-blind can tell apart; lines differ in dash, too.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..solver.kernel_cache import write_atomically

if TYPE_CHECKING:
    from .closed_loop import ClosedLoopResult

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
# name of the signal: label, factor to the unit shown, unit
_SHOWN = {
    "x": ("position $x$", 1e2, "cm"),
    "v": ("velocity $v$", 1e2, "cm/s"),
    "z": ("bristles $z$", 1e6, "µm"),
    "i": ("current $i$", 1e3, "mA"),
    "friction": ("friction", 1.0, "N"),
    "u": ("motor voltage $u$", 1.0, "V"),
}


def _axis(name: str) -> tuple[str, float, str]:
    return _SHOWN.get(name, (name, 1.0, ""))


def _label(name: str) -> str:
    text, _, unit = _axis(name)
    return f"{text} [{unit}]" if unit else text


def write_figure(figure: Any, folder: Path, stem: str) -> None:
    for kind in ("png", "svg"):
        stream = io.BytesIO()
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(stream, format=kind, metadata=metadata, bbox_inches="tight")
        write_atomically(folder / f"{stem}.{kind}", stream.getvalue())


def new_figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def save_run_pictures(result: ClosedLoopResult, folder: Path) -> None:
    """Write position, voltage, states and phase as PNG and SVG into `folder`."""
    import matplotlib as mpl

    run = result.run
    name = result.study.label
    badge = run.verdict.word
    title = f"{name}, {run.coupling.value} coupling: {badge}"
    with mpl.rc_context(STYLE):
        if "x" in run.outputs:
            figure, ((axes,),) = new_figure(1, 1, (8, 4.2))
            _draw_course(axes, run.time, run.outputs["x"], "x", 0, "position")
            axes.plot(
                run.time, run.reference * 1e2, color="#555555", lw=1, ls=":", label="set-point"
            )
            axes.set_title(title)
            axes.legend(loc="best")
            write_figure(figure, folder, "position")
        if "u" in run.commands:
            figure, ((axes,),) = new_figure(1, 1, (8, 4.2))
            _draw_course(axes, run.time, run.commands["u"], "u", 1, "voltage")
            peak = int(np.argmax(np.abs(run.commands["u"])))
            axes.annotate(
                f"{run.commands['u'][peak]:.1f} V at {run.time[peak]:.3f} s",
                (run.time[peak], run.commands["u"][peak]),
                xytext=(25, -6),
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "color": "#555555"},
            )
            axes.set_title(title)
            write_figure(figure, folder, "voltage")
        shown: list[str] = [n for n in ("x", "v", "z", "i", "friction") if n in run.outputs]
        shown = shown or list(run.outputs)
        figure, axes_grid = new_figure(len(shown), 1, (8, 2.0 * len(shown)))
        for k, n in enumerate(shown):
            _draw_course(axes_grid[k][0], run.time, run.outputs[n], n, k, n)
            axes_grid[k][0].set_xlabel("")
        axes_grid[-1][0].set_xlabel("time [s]")
        axes_grid[0][0].set_title(title)
        figure.align_ylabels()
        write_figure(figure, folder, "states")
        if {"x", "v"} <= set(run.outputs) and len(run.time) > 2:
            figure, ((axes,),) = new_figure(1, 1, (6.5, 5.2))
            _draw_phase(figure, axes, run)
            axes.set_title(title)
            write_figure(figure, folder, "phase")


def _draw_course(axes: Any, time: Any, values: Any, name: str, colour: int, label: str) -> None:
    _, factor, _ = _axis(name)
    axes.plot(time, values * factor, color=COLOURS[colour % len(COLOURS)], label=label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(_label(name))
    axes.margins(x=0.01)


def _draw_phase(figure: Any, axes: Any, run: Any) -> None:
    from matplotlib.collections import LineCollection

    error = (run.outputs["x"] - run.reference) * 1e2
    speed = run.outputs["v"] * 1e2
    points = np.column_stack([error, speed])
    lines = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)),
        cmap="viridis",
        linewidths=2.4,
        capstyle="round",
    )
    # colours span the motion, not the rest after it
    span = np.maximum(np.ptp(points, axis=0), 1e-12)
    moved = np.cumsum(np.hypot(*(np.diff(points, axis=0) / span).T))
    motion_end = run.time[int(np.searchsorted(moved, 0.999 * moved[-1])) + 1]
    lines.set_array(run.time[:-1])
    lines.set_clim(0.0, motion_end)
    axes.add_collection(lines)
    axes.autoscale_view()
    axes.plot(*points[0], "o", color=COLOURS[0], label="start")
    axes.plot(*points[-1], "X", color=COLOURS[1], ms=9, label="end")
    axes.set_xlabel("position error $x - x_d$ [cm]")
    axes.set_ylabel(_label("v"))
    axes.legend(loc="best")
    figure.colorbar(lines, ax=axes, label="time [s]", extend="max")


def save_comparison_picture(results: Sequence[ClosedLoopResult], folder: Path) -> None:
    """Write one picture of several controllers on the same plant."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, grid = new_figure(3, 1, (9, 9))
        position, fine, voltage = (row[0] for row in grid)
        ends = []
        for k, result in enumerate(results):
            run = result.run
            label = result.study.label
            if not result.trusted:
                label += " (not converged)"
            style = {
                "color": COLOURS[k % len(COLOURS)],
                "ls": DASHES[k % len(DASHES)],
                "label": label,
            }
            position.plot(run.time, run.outputs["x"] * 1e2, **style)
            distance = np.maximum(np.abs(run.outputs["x"] - run.reference) * 1e6, 1e-3)
            fine.semilogy(run.time, distance, **style)
            voltage.plot(run.time, run.commands["u"], **style)
            settled = result.figures().get("settling_time_2pct")
            ends.append(1.6 * settled if settled else run.time[-1])
        run = results[0].run
        position.plot(run.time, run.reference * 1e2, color="#555555", lw=1, ls=":")
        position.set_ylabel(_label("x"))
        position.set_title("Controllers on the same axis")
        position.legend(loc="lower right")
        fine.set_ylabel("distance to the set-point\n[µm], 1 nm at least")
        voltage.set_ylabel(_label("u"))
        voltage.set_xlabel("time [s]")
        for axes in (position, voltage):
            axes.set_xlim(0, min(max(ends), run.time[-1]))
        fine.set_xlim(0, run.time[-1])
        figure.align_ylabels()
        write_figure(figure, folder, "comparison")
