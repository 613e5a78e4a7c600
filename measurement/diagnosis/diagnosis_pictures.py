"""Pictures of a diagnosis: residuals over time, position and velocity; forces."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt

from ...orchestration.loop.pictures import COLOURS, STYLE, new_figure
from ...orchestration.loop.shown import shown_unit
from ...solver.arrays import Mask, Vector
from .diagnosis import Curves, Diagnosis

SMOOTH = 0.1  # averaging time of a force residual in pictures [s]
_MOST = 4000  # points of a curve
_BINS = 60
_LEAST_IN_BIN = 20
_SHOWN = 0.95  # share of the means over position within the height of their picture
_CAUSE, _SHAPE, _MEASURED = COLOURS[2], COLOURS[3], "#999999"


def thinned(x: Vector, y: Vector, most: int = _MOST) -> tuple[Vector, Vector]:
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
    """Means of y over parts of the range of x, NaN for parts with almost no samples.

    The parts have equal width or, with `alike`, equal numbers of samples, for speeds held constant.
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


def diagnosis_figure(diagnosis: Diagnosis) -> Any:
    """A figure of the residual before and after, in force and position."""
    import matplotlib as mpl

    c = diagnosis.curves
    time = end_to_end(c)
    step = float(np.median(np.diff(c.time)))
    size, unit = shown_unit(c.position_before, "m")
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(2, 1, (9, 6))
        force, position = grid[0][0], grid[1][0]
        for forces, places, colour, dash, label in (
            (c.before, c.position_before, COLOURS[1], "-", "prior model"),
            (c.after, c.position_after, COLOURS[0], "--", "corrected"),
        ):
            look = {"color": colour, "ls": dash, "lw": 1.2, "label": label}
            force.plot(*thinned(time, smoothed(forces, c.record, step)), **look)
            position.plot(*thinned(time, size * places), **look)
        force.set_title(f"Residual before and after: {diagnosis.verdict}", loc="left")
        force.set_ylabel(f"force, means over {SMOOTH:g} s [N]")
        position.set_ylabel(f"position after up to 1 s [{unit}]")
        position.set_xlabel("time [s]")
        for axes in (force, position):
            axes.margins(x=0.01)
        force.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        figure.align_ylabels()
    return figure


def forces_figure(diagnosis: Diagnosis) -> Any:
    """A figure of the force, measured and by each model, and of the force of causes, if any."""
    import matplotlib as mpl

    c = diagnosis.curves
    time = end_to_end(c)
    parts = [
        (label, colour, values)
        for label, colour, values in (
            ("named causes", _CAUSE, c.cause),
            ("no known cause", _SHAPE, c.shape),
        )
        if np.nansum(np.abs(values))
    ]
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(1 + bool(parts), 1, (9, 3 * (1 + bool(parts))))
        shown = grid[:, 0]
        for values, colour, width, label in (
            (c.force, _MEASURED, 3.0, "measured"),
            (c.predicted, COLOURS[1], 1.2, "prior model"),
            (c.force - c.after, COLOURS[0], 1.2, "corrected"),
        ):
            shown[0].plot(*thinned(time, values), color=colour, lw=width, label=label)
        shown[0].set_title("Friction and all other forces that oppose the motion", loc="left")
        for label, colour, values in parts:
            shown[1].plot(*thinned(time, values), color=colour, lw=1.2, label=label)
        for axes, name in zip(shown, ("force", "force of causes"), strict=False):
            axes.set_ylabel(f"{name} [N]")
            axes.margins(x=0.01)
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        shown[-1].set_xlabel("time [s]")
        figure.align_ylabels()
    return figure


def places_figure(diagnosis: Diagnosis) -> Any:
    """A figure of the mean force residual over position, by direction, and over velocity."""
    import matplotlib as mpl

    c = diagnosis.curves
    models = (
        ("prior model", COLOURS[1], c.before),
        ("corrected", COLOURS[0], c.after),
    )
    ways = (("forwards", c.v > 0, "-"), ("backwards", c.v < 0, "--"))
    with mpl.rc_context(STYLE):
        figure, ((over_position,), (over_velocity,)) = new_figure(2, 1, (9, 6))
        means = []
        for label, colour, values in models:
            for way, there, dash in ways:
                x, y = binned(c.x, values, c.telling & there)
                look: dict[str, Any] = {"color": colour, "ls": dash, "label": f"{label}, {way}"}
                over_position.plot(1e3 * x, y, **look)
                means.append(y)
            v, y = binned(c.v, values, c.telling, alike=True)
            over_velocity.plot(1e3 * v, y, ".", color=colour, label=label)
        height = _height(np.concatenate(means))
        if height:  # outliers do not hide the rest
            low, high = over_position.get_ylim()
            over_position.set_ylim(max(low, -height), min(high, height))
        over_position.set_title("Mean residual: a load has one sign in both directions", loc="left")
        for axes, name in ((over_position, "position [mm]"), (over_velocity, "velocity [mm/s]")):
            axes.set_xlabel(name)
            axes.set_ylabel("mean residual [N]")
        figure.legend(
            *over_position.get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
    return figure


def _height(values: Vector) -> float:
    """Half the height of a picture that contains nearly all values."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.5 * float(np.quantile(finite, _SHOWN)) if len(finite) else 0.0
