"""Pictures of a diagnosis: for its page, with zoom, and for papers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.page import Line, Picture, level, thinned
from ..orchestration.pictures import COLOURS, STYLE, drawing, in_words, new_figure, write_figure
from ..orchestration.shown_units import shown_unit
from ..orchestration.turning_words import words_for
from .diagnosis import Curves, Diagnosis

Vector = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SMOOTH = 0.1  # averaging time of a force residual in pictures [s]
CORRECTED = "corrected"
_BINS = 60
_LEAST_IN_BIN = 20
_SHOWN = 0.995  # share of a curve's samples within the initial height of a picture
_MEANS_SHOWN = 0.95
_TIME = "time [s]"


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


def said(pictures: Iterable[Picture], words: Callable[[str], str]) -> list[Picture]:
    """The pictures with all their texts changed by `words`."""
    return [
        replace(
            p,
            title=words(p.title),
            says=words(p.says),
            x_label=words(p.x_label),
            y_label=words(p.y_label),
        )
        for p in pictures
    ]


def pictures_of(diagnosis: Diagnosis) -> list[Picture]:
    """Pictures of the records for the page."""
    time = end_to_end(diagnosis.curves)
    corrected = "with all causes found" if diagnosis.unnamed else CORRECTED
    return [
        _force(diagnosis.curves, time, corrected),
        _residual_over_time(diagnosis, time, corrected),
        _residual_over_position(diagnosis.curves, corrected),
        _residual_over_velocity(diagnosis.curves, corrected),
        _position_residual(diagnosis, time, corrected),
        *_force_of_causes(diagnosis.curves, time),
    ]


def _force(c: Curves, time: Vector, corrected: str) -> Picture:
    label = f"{corrected} model" if corrected == CORRECTED else corrected
    return Picture(
        "force",
        "Force: measured and predicted",
        "Friction and all other forces that oppose the motion: from the record, "
        "and from each model.",
        _TIME,
        "force [N]",
        (
            Line("measured", "measured", time, c.force),
            Line("prior model", "before", time, c.predicted),
            Line(label, "after", time, c.force - c.after),
        ),
    )


def _residual_over_time(diagnosis: Diagnosis, time: Vector, corrected: str) -> Picture:
    c = diagnosis.curves
    step = float(np.median(np.diff(c.time)))
    before, after = (smoothed(v, c.record, step) for v in (c.before, c.after))
    return Picture(
        "residual_time",
        "Force residual over time",
        f"Means over {SMOOTH:g} s; pale: "
        f"every sample. Noise alone is {diagnosis.floor.force:.3g} N rms.",
        _TIME,
        "residual [N]",
        (
            Line(f"every sample, {corrected}", "after faint", time, c.after),
            Line("prior model", "before", time, before),
            Line(corrected, "after", time, after),
        ),
        _height(np.concatenate([before, after]), _SHOWN),
    )


def _residual_over_position(c: Curves, corrected: str) -> Picture:
    ways = {"forwards": c.telling & (c.v > 0), "backwards": c.telling & (c.v < 0)}
    lines = tuple(
        Line(f"{label}, {way}", style, 1e3 * x, y)
        for label, colour, values in _residuals(c, corrected)
        for way, style in (("forwards", colour), ("backwards", f"{colour} dashed"))
        for x, y in (binned(c.x, values, ways[way]),)
    )
    return Picture(
        "residual_position",
        "Force residual over position, by direction",
        "Means over parts of the travel. Friction changes sign with the direction; a "
        "load does not.",
        "position [mm]",
        "mean residual [N]",
        lines,
        _height(np.concatenate([line.y for line in lines]), _MEANS_SHOWN),
    )


def _residual_over_velocity(c: Curves, corrected: str) -> Picture:
    return Picture(
        "residual_velocity",
        "Force residual over velocity",
        "Means over neighbouring speeds, with the same number of samples each.",
        "velocity [mm/s]",
        "mean residual [N]",
        tuple(
            Line(label, f"{colour} dots", 1e3 * x, y)
            for label, colour, values in _residuals(c, corrected)
            for x, y in (binned(c.v, values, c.telling, alike=True),)
        ),
    )


def _residuals(c: Curves, corrected: str) -> tuple[tuple[str, str, Vector], ...]:
    """Label, colour and force residual of each model."""
    return ("prior model", "before", c.before), (corrected, "after", c.after)


def _position_residual(diagnosis: Diagnosis, time: Vector, corrected: str) -> Picture:
    c = diagnosis.curves
    factor, unit = shown_unit(c.position_before, "m")
    return Picture(
        "position_residual",
        "Position residual over time",
        "Error of the position predicted from the start of each second.",
        _TIME,
        f"residual [{unit}]",
        (
            Line("prior model", "before", time, factor * c.position_before),
            Line(corrected, "after", time, factor * c.position_after),
            level("noise alone, rms", time, factor * (diagnosis.floor.position or np.nan)),
        ),
    )


def _force_of_causes(c: Curves, time: Vector) -> list[Picture]:
    """Pictures of the causes' force; none if no cause is a force, such as an instrument error."""
    lines = []
    if np.any(c.cause):
        lines.append(Line("named causes", "cause", time, c.cause))
    if np.nansum(np.abs(c.shape)):
        lines.append(Line("no known cause", "shape", time, c.shape))
    says = "Force that the named causes add to the model, and the residual without a known cause."
    causes = Picture("causes", "Force of the causes", says, _TIME, "force [N]", tuple(lines))
    return [causes] if lines else []


def _height(values: Vector, share: float) -> float | None:
    """Height that contains this share of the values, so that outliers do not hide the rest."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.5 * float(np.quantile(finite, share)) or None if len(finite) else None


@drawing()
def save_pictures(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.png: the residual before and after, in force and position.

    Raises
    ------
    OSError
        If they cannot be written.
    """
    words = words_for(diagnosis.notes)
    write_figure(in_words(diagnosis_figure(diagnosis), words), folder, "diagnosis")


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
