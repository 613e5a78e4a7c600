"""The pictures of a diagnosis and of a comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...orchestration.loop.pictures import COLOURS, DASHES, STYLE, new_figure
from ...orchestration.loop.shown import shown_unit
from ...solver.arrays import Mask, Vector
from .compare import Compared
from .diagnosis import Curves, Diagnosis
from .report import WORDS

_MOST_POINTS = 6000
_SHOWN = (0.002, 0.998)  # quantiles of a curve at the lower and upper end of a picture
_MEASURED, _REST = "#000000", "#e8e8e8"
_BINS, _LEAST_IN_BIN = 60, 20  # parts of a signal's range, and samples in each that count


def diagnosis_figure(d: Diagnosis) -> Any:
    """Mean error of the force before and after, over what it may go with."""
    import matplotlib as mpl

    c = d.curves
    ways = (("forwards", c.v > 0.0, "-"), ("backwards", c.v <= 0.0, "--"))
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(2, 2, (12, 7.5))
        for axes, (name, unit, signal, alike) in zip(grid.flat, _signals(c), strict=True):
            share = 0.0
            axes.sharey(grid[0][0])
            for label, colour, wide, values in (
                ("your model", COLOURS[1], 2.8, c.before),
                ("corrected", COLOURS[0], 1.2, c.after),
            ):
                for way, there, dash in ways:
                    kept = c.telling & there
                    x, y = binned(signal, values, kept, alike)
                    axes.plot(x, y, dash, color=colour, lw=wide, label=f"{label}, {way}")
                    share += _share(signal, c.before, c.telling, kept, x, y) * (values is c.before)
            axes.set_title(f"{100 * share:.0f} % goes with the {name}", loc="left")
            axes.set(xlabel=f"{name} [{unit}]", ylabel="mean error of the force [N]")
        figure.suptitle(f"What the error of the force goes with: {WORDS[d.verdict]}", fontsize=12)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _signals(c: Curves) -> list[tuple[str, str, Vector, bool]]:
    """Name, unit and signal of each panel; whether its parts have equal numbers of samples."""
    steps = np.diff(c.time, prepend=c.time[0])
    again = np.append(True, np.diff(c.record) > 0)
    time = np.cumsum(np.where(again, 0.0, steps))
    turned = again | (np.diff(np.sign(c.v), prepend=np.sign(c.v[0])) != 0.0)
    since = time - np.maximum.accumulate(np.where(turned, time, 0.0))
    return [
        ("position", "mm", 1e3 * c.x, False),
        ("velocity", "mm/s", 1e3 * c.v, True),
        ("time since reversal", "ms", 1e3 * since, True),
        ("time", "s", time, False),
    ]


def _share(signal: Vector, error: Vector, all_: Mask, kept: Mask, x: Vector, y: Vector) -> float:
    """Share of the mean square of an error that its means over a signal have."""
    known = np.isfinite(y)
    if not known.any():
        return 0.0
    whole = float(np.sum(error[all_] ** 2))
    mean = np.interp(signal[kept], x[known], y[known])
    gone = np.sum(error[kept] ** 2) - np.sum((error[kept] - mean) ** 2)
    return max(float(gone) / whole, 0.0) if whole else 0.0


def compare_figure(found: Compared) -> Any:
    """Error of the position and the force over time, and friction over velocity."""
    import matplotlib as mpl

    first, *_ = found.traces.values()
    begins_again = np.append(found.starts[1:], False)
    with mpl.rc_context(STYLE):
        figure, ((off, force, over_velocity),) = new_figure(1, 3, (18, 5.5))
        off.sharex(force)
        figure.suptitle(found.says[0].upper() + found.says[1:], fontsize=12)
        errors = {n: t.predicted - found.x for n, t in found.traces.items() if not t.why}
        size, unit = shown_unit(np.concatenate([*errors.values(), np.zeros(1)]), "m")
        look = {"color": _MEASURED, "lw": 1.2, "label": "required by the motion"}
        force.plot(found.time, first.required, **look)
        some = np.flatnonzero(first.counted)
        some = some[:: max(1, len(some) // _MOST_POINTS)]
        look = {"ms": 2.5, "color": COLOURS[5], "label": "record, while moving", "rasterized": True}
        over_velocity.plot(1e3 * found.v[some], first.required[some], ".", **look)
        for k, (name, t) in enumerate(found.traces.items()):
            label = name if name == "model" else f"{name} model"
            style = {"color": COLOURS[(1, 4, 0)[k]], "ls": DASHES[k], "lw": 1.3, "label": label}
            if name in errors:
                off.plot(found.time, np.where(begins_again, np.nan, size * errors[name]), **style)
            of_law = first.required - t.force
            force.plot(found.time, of_law, **style)
            v, friction = binned(found.v, of_law, first.counted, alike=True)
            over_velocity.plot(1e3 * v, friction, **{**style, "lw": 2.0})
        grey = "; grey: at rest" if found.rests.any() else ""
        off.set_title("Error of the position, predicted each second", loc="left")
        off.set(ylabel=f"predicted minus measured [{unit}]", xlabel=f"time [s]{grey}")
        force.set_title("Force against the motion", loc="left")
        force.set(ylabel="force [N]", xlabel="time [s]")
        over_velocity.set_title("Friction over velocity", loc="left")
        over_velocity.set(xlabel="velocity [mm/s]", ylabel="friction [N]")
        # a jump of friction makes few samples large
        low, high = np.quantile(first.required, _SHOWN)
        room = 0.1 * max(high - low, 1e-9)
        force.set_ylim(low - room, high + room)
        over_velocity.sharey(force)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], found.rests, [0]])))
        for begin, end in zip(found.time[edges[::2]], found.time[edges[1::2] - 1], strict=True):
            for axes in (off, force):
                axes.axvspan(begin, end, color=_REST, lw=0, zorder=0)
        known = force.get_legend_handles_labels()
        figure.legend(*known, loc="outside lower left", ncols=4, fontsize=10)
        over_velocity.legend(loc="upper left", fontsize=10)
    return figure


def binned(x: Vector, y: Vector, keep: Mask, alike: bool = False) -> tuple[Vector, Vector]:
    """Means of y over parts of the range of x, NaN for parts with almost no samples.

    The parts have equal width or, with `alike`, equal numbers of samples, for speeds held constant.
    """
    if not np.any(keep) or np.ptp(x[keep]) == 0:
        return np.array([np.nan]), np.array([np.nan])
    if alike:
        order = np.flatnonzero(keep)[np.argsort(x[keep], kind="stable")]
        parts = np.array_split(order, min(2 * _BINS, max(1, len(order) // _LEAST_IN_BIN)))
        return np.array([x[k].mean() for k in parts]), np.array([y[k].mean() for k in parts])
    count, edges = np.histogram(x[keep], _BINS)
    total, _ = np.histogram(x[keep], edges, weights=y[keep])
    mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean
