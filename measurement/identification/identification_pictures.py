"""Pictures of an identification: the friction map with the fit, and the residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...orchestration.loop.pictures import COLOURS, DASHES, styled_figure
from .fitted_law import OFFSET, claim_of
from .identifiability import FORWARDS
from .identification import SIDES

if TYPE_CHECKING:
    from .identification import Identification
    from .response import Response

MOST_POINTS = 6000
PARTS = 60  # of a curve


def identification_figures(result: Identification) -> dict[str, Any]:
    """Figures of friction over velocity and of the residuals, by name."""
    figures = {}
    course, fit = result.course, result.fit
    open_ones = [n for n, i in result.parameters.items() if not i.identified]
    word = "identified" if result.trusted else "not trusted"
    if len(open_ones) == len(result.warnings) > 0:
        word = "all but " + ", ".join(open_ones)
    count = len(result.records)
    title = f"{result.law} from {count} record{'s' if count > 1 else ''}: {word}"
    measured = course.force - course.inertial
    friction = fit.predicted - course.inertial
    with styled_figure(1, 2, (11, 4.6)) as (figure, ((over_velocity, over_way),)):
        some = slice(None, None, max(1, len(course.x) // MOST_POINTS))
        _scatter(over_velocity, 1e3 * course.v[some], measured[some], friction[some])
        _draw_curves(over_velocity, result)
        over_velocity.set(xlabel="velocity [mm/s]", ylabel="friction [N]", title=title)
        over_velocity.legend(loc="best", fontsize=9)
        begin = course.x[course.starts[:-1]][course.owner()]
        way = 1e6 * (course.x - begin)
        near = np.abs(way) < 100
        _scatter(over_way, way[near], measured[near], friction[near])
        over_way.set(xlabel="displacement from the start [µm]", ylabel="friction [N]")
        over_way.set_title("Presliding")
        figures["friction_map"] = figure
    with styled_figure(2, 1, (9, 6)) as (figure, grid):
        course_axes, histogram = grid[0][0], grid[1][0]
        residual = course.force - fit.predicted
        for r, part in enumerate(course.parts()):
            time = course.step[r] * np.arange(part.stop - part.start)
            style = {"lw": 0.6, "color": COLOURS[r % len(COLOURS)], "rasterized": True}
            course_axes.plot(time, residual[part], **style)
        course_axes.set(xlabel="time in the record [s]", ylabel="force less fit [N]", title=title)
        spread = max(4 * float(residual.std()), 1e-9)
        style = {"color": COLOURS[0], "alpha": 0.8, "density": True}
        histogram.hist(residual, bins=80, range=(-spread, spread), **style)
        histogram.set(xlabel="force less fit [N]", ylabel="density [1/N]")
        figures["residuals"] = figure
    return figures


def _draw_curves(axes: Any, result: Identification) -> None:
    """Draw friction at constant velocity, with each direction's parameters if both are known."""
    constant = result.fit.values.get(OFFSET, 0.0)
    tops = (float(result.course.v.max()), float(result.course.v.min()))
    for (side, end), top, dash in zip(SIDES.items(), tops, DASHES[:2], strict=True):
        if (top > 0) != (side == FORWARDS):
            continue
        values = {n: i.value for n, i in result.per_direction.get(side, {}).items()}
        if result.fit.law.directional:
            values = {n + end: v for n, v in values.items()}
        values = values or {n: i.value for n, i in result.parameters.items()}
        speeds = top * np.linspace(0.0, 1.0, PARTS + 1)[1:] ** 2  # more points at low speed
        curve = claim_of(result.law, "steady_state", values, speeds) + np.full(PARTS, constant)
        axes.plot(1e3 * speeds, curve, ls=dash, color=COLOURS[6], lw=1.2, label=f"law, {side}")


def response_figure(result: Response) -> Any:
    """Figure of a frequency response: magnitude, phase and coherence over frequency."""
    known = np.where(result.coherent, result.position, np.nan)
    rows = {
        f"position per input [m/{result.unit}]": np.abs(known),
        "phase [deg]": np.degrees(np.angle(known)),
        "coherence [1]": result.coherence,
    }
    with styled_figure(3, 1, (8, 8)) as (figure, grid):
        for (axes,), (label, values) in zip(grid, rows.items(), strict=True):
            axes.plot(result.frequency, values, color=COLOURS[0], lw=1.0)
            axes.set(xscale="log", ylabel=label)
            if result.resonance:
                axes.axvline(result.resonance.value, color=COLOURS[1], ls="--", lw=1.0)
        grid[0][0].set(yscale="log")
        grid[0][0].set_title(result.said, fontsize=10)
        grid[2][0].set(ylim=(0, 1.05), xlabel="frequency [Hz]")
    return figure


def _scatter(axes: Any, where: Any, measured: Any, friction: Any) -> None:
    style = {"ls": "none", "rasterized": True}
    axes.plot(where, measured, ".", ms=2.5, color=COLOURS[5], label="measured", **style)
    axes.plot(where, friction, ".", ms=1.5, color=COLOURS[1], label="fit", **style)
