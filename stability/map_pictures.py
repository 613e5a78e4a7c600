"""Pictures of stability maps, as in Fig. 3.18 of the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.loop.pictures import STYLE, drawing, new_figure, write_figure
from ..orchestration.loop.shown_units import labelled, shown_unit
from ..solver.kernel import PLANT
from ..solver.tables import read_table, table_path
from .attractor import Kind
from .map_plan import position_unit
from .store import TABLE

if TYPE_CHECKING:
    from .map_plan import MapPlan

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

_BOUNDARY_POINTS = 48
BOUNDARY = "limit of stability while the block is stuck (Routh-Hurwitz)"


@drawing()
def save_map_picture(plan: MapPlan, folder: Path) -> None:
    """Draw the map's table in `folder`, and save the picture next to it."""
    write_figure(map_figure(plan, folder), folder, "map")


@dataclass(frozen=True)
class Panel:
    """One number of each cell.

    Attributes
    ----------
    title, label : str
    values : ndarray, shape (y.count, x.count)
    least : float
        Smallest value of a logarithmic scale; 0 for a linear scale around zero.
    """

    title: str
    label: str
    values: npt.NDArray[np.float64]
    least: float = 0.0

    def range(self) -> tuple[float, float]:
        """The range of the colours."""
        finite = self.values[np.isfinite(self.values)]
        if self.least:
            finite = finite[finite > 0.0]
            low, high = (finite.min(), finite.max()) if len(finite) else (self.least, self.least)
            return max(float(low), self.least), max(float(high), 10 * self.least)
        bound = (float(np.percentile(np.abs(finite), 99)) if len(finite) else 0.0) or 1.0
        return -bound, bound


def _verdicts_and_panels(plan: MapPlan, folder: Path) -> tuple[npt.NDArray[np.int64], list[Panel]]:
    """Numbers of the verdicts in `COLOUR`, and the other panels, from the table in `folder`."""
    table = read_table(table_path(folder, TABLE))
    shape = (plan.y.count, plan.x.count)

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(table[name], dtype=float).reshape(shape)

    kinds = list(COLOUR)
    verdict = np.array([kinds.index(Kind(v)) for v in table["verdict"]]).reshape(shape)
    distance, swing = np.abs(column("final_error")), column("oscillation_amplitude")
    unit = position_unit(plan)
    goal = "zero" if plan.loop.controller.is_none else "the set-point"
    least = 1e-10  # a tenth of a nanometre is no motion
    panels = []
    for title, label, values in (
        (f"Distance to {goal} at the end", "distance", distance),
        ("Amplitude at the end", "amplitude", swing),
    ):
        factor, shown = shown_unit(values, unit)
        panels.append(Panel(title, labelled(label, shown), factor * values, factor * least))
    rate = column("lambda1_bits_per_s")
    if np.isfinite(rate).any():
        panels.append(Panel("Largest Lyapunov exponent", "exponent [bits/s]", rate))
    return verdict, panels


def map_figure(plan: MapPlan, folder: Path) -> Any:
    """A figure of the map's table in `folder`: verdicts, distances, swings, exponents."""
    import matplotlib as mpl
    from matplotlib.colors import ListedColormap, LogNorm
    from matplotlib.patches import Patch

    kinds = list(COLOUR)
    verdict, panels = _verdicts_and_panels(plan, folder)
    found = _boundary(plan)
    xs, ys = plan.x.values(), plan.y.values()
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure, (axes,) = new_figure(1, 1 + len(panels), (5.6 * (1 + len(panels)), 5.4))
        axes[0].pcolormesh(
            xs,
            ys,
            verdict,
            cmap=ListedColormap([COLOUR[k] for k in kinds]),
            vmin=-0.5,
            vmax=len(kinds) - 0.5,
            rasterized=True,
        )
        met = [Patch(color=COLOUR[k], label=k.value) for n, k in enumerate(kinds) if n in verdict]
        axes[0].set_title(f"{plan.loop.label}: motion at the end")
        line = _draw_boundary(axes[0], found)
        figure.legend(handles=met + line, loc="outside lower center", ncols=len(met) + len(line))
        for place, panel in zip(axes[1:], panels, strict=True):
            low, high = panel.range()
            values = np.maximum(panel.values, panel.least or low)  # minus infinity, too
            style: dict[str, Any] = {"cmap": "PuOr", "vmin": low, "vmax": high}
            if panel.least:
                style = {"cmap": "viridis", "norm": LogNorm(low, high)}
            image = place.pcolormesh(xs, ys, values, rasterized=True, **style)
            figure.colorbar(image, ax=place, label=panel.label)
            place.set_title(panel.title)
            _draw_boundary(place, found)
        for place in axes:
            place.set_xlabel(_label(plan, plan.x.name))
            place.ticklabel_format(useOffset=False, axis="both")
            place.tick_params(axis="x", rotation=30)
        axes[0].set_ylabel(_label(plan, plan.y.name))
    return figure


def _label(plan: MapPlan, name: str) -> str:
    from .map_plan import axis_unit

    unit = axis_unit(plan, name)
    return labelled(name, "" if unit == "1" else unit)


def _draw_boundary(axes: Any, found: Boundary | None) -> list[Any]:
    """Draw the line of zero growth of the loop while stuck; return its legend entries."""
    from matplotlib.lines import Line2D

    if found is None:
        return []
    axes.contour(*found, levels=[0.0], colors="black", linewidths=1.6, linestyles="--")
    return [Line2D([], [], color="black", ls="--", lw=1.6, label=BOUNDARY)]


def _boundary(plan: MapPlan) -> Boundary | None:
    """Growth while stuck; None if its sign does not change, or the criterion does not hold."""
    from .cell import stuck_growth
    from .map_plan import DESIGN, kernel_of

    if PLANT + "Kv" not in [p.name for p in kernel_of(plan).parameters]:
        return None  # the criterion needs friction with a smooth sign
    if DESIGN in (plan.x.side, plan.y.side):
        return None  # a design for each of its points would take longer than the map
    if kernel_of(plan).sample_time:
        return None  # the criterion needs continuous feedback
    xs = np.linspace(plan.x.low, plan.x.high, _BOUNDARY_POINTS)
    ys = np.linspace(plan.y.low, plan.y.high, _BOUNDARY_POINTS)
    growth = np.array([[stuck_growth(plan, float(x), float(y)) for x in xs] for y in ys])
    return (xs, ys, growth) if growth.min() < 0.0 < growth.max() else None
