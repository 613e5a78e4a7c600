"""Pictures of a diagnosis: for its page, drawn so that a browser can zoom them, and for papers.

In the page a picture is a frame with ticks around a drawing of 1000 by 1000 units, whose view is
what zooming changes; lines keep their width, and the ticks are drawn anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.pictures import COLOURS, STYLE, new_figure, write_figure
from .closed_loop_effect import SETPOINT, ClosedLoopEffect
from .diagnosis import Curves, Diagnosis
from .page_pictures import Line, Picture, level, thinned

Vector = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SMOOTH = 0.1  # time over which a force residual is averaged to be shown [s]
CORRECTED = "corrected"
_BINS = 60
_LEAST_IN_BIN = 20
_SHOWN = 0.995  # of the samples of a curve within a picture's height, at first
_MEANS_SHOWN = 0.95


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
    corrected = "with all that was found" if diagnosis.unnamed else CORRECTED
    before, after = (smoothed(v, c.record, step) for v in (c.before, c.after))
    ways = {"forwards": c.telling & (c.v > 0), "backwards": c.telling & (c.v < 0)}
    along = [
        Line(f"{label}, {way}", style, 1e3 * x, y)
        for label, colour, values in (
            ("prior model", "before", c.before),
            (corrected, "after", c.after),
        )
        for way, style in (("forwards", colour), ("backwards", f"{colour} dashed"))
        for x, y in (binned(c.x, values, ways[way]),)
    ]
    speed = [
        Line(label, f"{style} dots", 1e3 * x, y)
        for label, style, values in (
            ("prior model", "before", c.before),
            (corrected, "after", c.after),
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
                Line("prior model", "before", time, c.predicted),
                Line(
                    f"{corrected} model" if corrected == CORRECTED else corrected,
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
                Line(f"every sample, {corrected}", "after faint", time, c.after),
                Line("prior model", "before", time, before),
                Line(corrected, "after", time, after),
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
            "By how much a position predicted from the start of each second is wrong.",
            x_time,
            f"residual [{unit}]",
            (
                Line("prior model", "before", time, factor * c.position_before),
                Line(corrected, "after", time, factor * c.position_after),
                level("noise alone, rms", time, factor * floor.position),
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
            "Distance to the set-point, for the prior plant and with the causes.",
            "time [s]",
            "error [mm]",
            (
                Line("prior plant", "before", time, milli * (effect.prior.x - SETPOINT)),
                Line(
                    "extended plant", "after dashed", time, milli * (effect.extended.x - SETPOINT)
                ),
            ),
        ),
        Picture(
            "loop_difference",
            "Closed loop: what the causes change",
            "Position of the extended plant less that of the prior one.",
            "time [s]",
            "difference [µm]",
            (Line("difference", "cause", time, 1e6 * (effect.extended.x - effect.prior.x)),),
        ),
    ]


def _height(values: Vector, share: float) -> float | None:
    """What shows so many of the values, and keeps a few that are far off from hiding the rest."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.5 * float(np.quantile(finite, share)) or None if len(finite) else None


def save_pictures(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.png: the residual before and after, in force and position.

    Raises
    ------
    OSError
        If they cannot be written.
    """
    write_figure(diagnosis_figure(diagnosis), folder, "diagnosis")


def diagnosis_figure(diagnosis: Diagnosis) -> Any:
    """A figure of the residual before and after, in force and position."""
    import matplotlib as mpl

    c = diagnosis.curves
    time = end_to_end(c)
    step = float(np.median(np.diff(c.time)))
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(2, 1, (9, 6))
        force, position = grid[0][0], grid[1][0]
        for values, colour, dash, label in (
            (c.before, COLOURS[1], "-", "prior model"),
            (c.after, COLOURS[0], "--", "corrected"),
        ):
            _plot(force, time, smoothed(values, c.record, step), colour, dash, label)
        for values, colour, dash, label in (
            (c.position_before, COLOURS[1], "-", "prior model"),
            (c.position_after, COLOURS[0], "--", "corrected"),
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
    return figure


def _plot(axes: Any, time: Vector, values: Vector, colour: str, dash: str, label: str) -> None:
    axes.plot(*thinned(time, values), color=colour, ls=dash, lw=1.2, label=label)
