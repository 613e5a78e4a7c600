"""Pictures of exponents and their convergence, and of stability maps as Fig. 3.18 of the thesis."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.loop.pictures import COLOURS, DASHES, drawing, styled_figure, write_figure
from ..orchestration.loop.shown import labelled, shown_unit
from ..solver.files import read_table, table_path
from ..solver.kernel import PLANT
from .attractor import Kind
from .lyapunov import BITS, LyapunovRun
from .map_plan import DESIGN, TABLE, Axis, MapPlan, axis_unit, kernel_of, stuck_growth

# Okabe and Ito's colours and grey; a verdict always has the same colour
COLOUR = {
    Kind.FIXED_POINT: "#009E73",
    Kind.LINE: "#56B4E9",
    Kind.REST: "#999933",
    Kind.CREEPING: "#0072B2",
    Kind.CYCLE: "#E69F00",
    Kind.TORUS: "#F0E442",
    Kind.CHAOS: "#CC79A7",
    Kind.DIVERGES: "#D55E00",
    Kind.BOUNDED: "#999999",
    Kind.WINDING: "#882255",
    Kind.UNDECIDED: "#000000",
}
Boundary = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Coordinates along x and y, and the growth of the loop while stuck, shape (y, x)."""
_BOUNDARY_POINTS = 24
BOUNDARY = "limit of stability while the block is stuck (Routh-Hurwitz)"
_NEUTRAL = "constant for a neutral direction, rising for chaos, falling for rest"
NO_MOTION = 1e-10  # a tenth of a nanometre


def moved_by(run: LyapunovRun) -> str:
    """How the second run differs, from which the error of the exponents is found."""
    if math.isnan(run.tolerance):
        return "half the step"
    over_fmus = run.loop is not None and run.loop.step is not None
    return "one solver without FMUs" if over_fmus else "a tenth of the tolerance"


def convergence_figure(run: LyapunovRun) -> Any:
    """A figure of the running estimates against time, with their limits."""
    time, rates, _ = run.running()
    if not len(time):  # the time for computing was used up before the first estimate
        time, rates = np.zeros(1), np.full((1, rates.shape[1]), np.nan)
    with styled_figure(2, 1, (8, 7.5)) as (figure, ((axes,), (drift,))):
        for k, course in enumerate(rates.T):
            known = np.isfinite(course)
            style = {"color": COLOURS[k % len(COLOURS)], "ls": DASHES[k % len(DASHES)]}
            unit = " bits/s" if known[-1] else ""
            label = f"exponent {k + 1}: {run.shown(course[-1])}{unit}"
            axes.plot(time[known], course[known] * BITS, label=label, **style)
        if run.motion.limit is not None:
            for value in run.motion.limit[np.isfinite(run.motion.limit)]:
                axes.axhline(value * BITS, color="#555555", lw=0.8, ls=":")
            axes.plot([], [], color="#555555", lw=0.8, ls=":", label="limits")
        last = np.abs(rates[-1][np.isfinite(rates[-1]) & (rates[-1] != 0.0)]) * BITS
        # linear below the smallest last estimate
        least = 10.0 ** np.floor(np.log10(last.min())) if len(last) else 1.0
        axes.set_yscale("symlog", linthresh=least)
        axes.set_ylabel("exponent up to now [bits/s]")
        kind = run.motion.kind.value
        axes.set_title(f"{run.label}: {kind}" if run.label else kind)
        axes.legend(loc="upper right", ncols=2)
        first = np.isfinite(rates[:, 0])
        drift.plot(time[first], (rates[:, 0] * time)[first] * BITS, color=COLOURS[0])
        drift.set_ylabel("exponent 1 times time [bits]")
        drift.set_title(_NEUTRAL.capitalize())
        drift.set_xlabel("time [s]")
        figure.align_ylabels()
    return figure


@drawing()
def save_map_picture(plan: MapPlan, folder: Path) -> None:
    """Draw the map's table in `folder`, and save the picture next to it."""
    write_figure(map_figure(plan, folder), folder, "map")


def map_figure(plan: MapPlan, folder: Path) -> Any:
    """A figure of the map's table in `folder`: verdicts, distances, swings, exponents."""
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    table = read_table(table_path(folder, TABLE))
    shape = (plan.y.count, plan.x.count)

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(table[name], dtype=float).reshape(shape)

    rate = column("lambda1_bits_per_s")
    with_rate = bool(np.isfinite(rate).any())
    kinds = list(COLOUR)
    verdict = np.array([kinds.index(Kind(v)) for v in table["verdict"]]).reshape(shape)
    boundary = _boundary(plan)
    where = plan.x.values(), plan.y.values()
    count = 3 + with_rate
    size = 5.6 * count, 5.4
    with styled_figure(1, count, size, **{"axes.grid": False}) as (figure, (axes,)):
        colours = {"cmap": ListedColormap([COLOUR[k] for k in kinds]), "rasterized": True}
        axes[0].pcolormesh(*where, verdict, vmin=-0.5, vmax=len(kinds) - 0.5, **colours)
        axes[0].set_title(f"{plan.loop.label}: motion at the end")
        goal = "zero" if plan.loop.controller.is_none else "the set-point"
        distance, swing = np.abs(column("final_error")), column("oscillation_amplitude")
        _lengths(axes[1], plan, distance, f"Distance to {goal} at the end", "distance")
        _lengths(axes[2], plan, swing, "Amplitude at the end", "amplitude")
        if with_rate:
            finite = np.abs(rate[np.isfinite(rate)])
            most = float(np.percentile(finite, 99)) or 1.0
            shown = np.maximum(rate, -most)  # minus infinity, too
            style = {"cmap": "PuOr", "vmin": -most, "vmax": most, "rasterized": True}
            image = axes[3].pcolormesh(*where, shown, **style)
            figure.colorbar(image, ax=axes[3], label="exponent [bits/s]")
            axes[3].set_title("Largest Lyapunov exponent")
        met: list[Any] = [
            Patch(color=COLOUR[k], label=k.value) for n, k in enumerate(kinds) if n in verdict
        ]
        if boundary:
            met.append(Line2D([], [], color="black", ls="--", lw=1.6, label=BOUNDARY))
        figure.legend(handles=met, loc="outside lower center", ncols=len(met))
        for place in axes:
            if boundary:
                style = {"colors": "black", "linewidths": 1.6, "linestyles": "--"}
                place.contour(*boundary, levels=[0.0], **style)
            place.set_xlabel(_label(plan, plan.x))
            place.ticklabel_format(useOffset=False, axis="both")
            place.tick_params(axis="x", rotation=30)
        axes[0].set_ylabel(_label(plan, plan.y))
    return figure


def _label(plan: MapPlan, axis: Axis) -> str:
    unit = axis_unit(plan, axis)
    return labelled(axis.name, "" if unit == "1" else unit)


def _lengths(
    axes: Any, plan: MapPlan, values: npt.NDArray[np.float64], title: str, label: str
) -> None:
    """Draw a length of each cell on a logarithmic scale."""
    from matplotlib.colors import LogNorm

    unit = next(s.unit for s in kernel_of(plan).states if s.name == PLANT + "x")
    factor, shown = shown_unit(values, unit)
    values, least = factor * values, factor * NO_MOTION
    positive = values[np.isfinite(values) & (values > 0.0)]
    low, high = (positive.min(), positive.max()) if len(positive) else (least, least)
    style = {"cmap": "viridis", "norm": LogNorm(max(low, least), max(high, 10 * least))}
    where = plan.x.values(), plan.y.values()
    image = axes.pcolormesh(*where, np.maximum(values, least), rasterized=True, **style)
    axes.figure.colorbar(image, ax=axes, label=labelled(label, shown))
    axes.set_title(title)


def _boundary(plan: MapPlan) -> Boundary | None:
    """Growth while stuck; None if its sign does not change, or the criterion does not hold."""
    smooth = PLANT + "Kv" in [p.name for p in kernel_of(plan).parameters]
    # a design for each of its points would take longer than the map
    designed = DESIGN in (plan.x.side, plan.y.side)
    if not smooth or designed or kernel_of(plan).sample_time:
        return None  # the criterion needs friction with a smooth sign, and continuous feedback
    xs = np.linspace(plan.x.low, plan.x.high, _BOUNDARY_POINTS)
    ys = np.linspace(plan.y.low, plan.y.high, _BOUNDARY_POINTS)
    growth = np.array([[stuck_growth(plan, float(x), float(y)) for x in xs] for y in ys])
    return (xs, ys, growth) if growth.min() < 0.0 < growth.max() else None
