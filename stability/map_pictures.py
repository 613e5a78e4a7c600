"""Pictures of stability maps, as in Fig. 3.18 of the thesis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.pictures import STYLE, drawing, new_figure, write_figure
from ..solver.kernel import PLANT
from ..solver.tables import read_table, table_path
from .attractor import Kind
from .map_plan import position_unit
from .store import TABLE

if TYPE_CHECKING:
    from .map_plan import MapPlan

# Okabe and Ito's colours and grey, the same verdict always the same one
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
_BOUNDARY_POINTS = 48


@drawing()
def save_map_picture(plan: MapPlan, folder: Path) -> None:
    """Draw the map's table in `folder` beside it."""
    write_figure(map_figure(plan, folder), folder, "map")


def map_figure(plan: MapPlan, folder: Path) -> Any:
    """A figure of the map's table in `folder`: verdicts, distances, swings, exponents."""
    import matplotlib as mpl
    from matplotlib.colors import ListedColormap, LogNorm
    from matplotlib.patches import Patch

    table = read_table(table_path(folder, TABLE))
    shape = (plan.y.count, plan.x.count)

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(table[name], dtype=float).reshape(shape)

    kinds = list(COLOUR)
    verdict = np.array([kinds.index(Kind(v)) for v in table["verdict"]])
    verdict = verdict.reshape(shape)
    xs, ys = plan.x.values(), plan.y.values()
    unit = position_unit(plan)
    factor, shown = (1e6, "[µm]") if unit == "m" else (1.0, f"[{unit}]" if unit != "1" else "")
    goal = "zero" if plan.loop.controller.is_none else "the set-point"
    distance, swing = f"Distance to {goal} at the end", "Amplitude at the end"
    panels: list[tuple[str, str, Any]] = [
        (distance, f"|error of x| {shown}", np.abs(column("final_error")) * factor),
        (swing, f"amplitude of x {shown}", column("oscillation_amplitude") * factor),
    ]
    rate = column("lambda1_bits_per_s")
    if np.isfinite(rate).any():
        panels.append(("Largest Lyapunov exponent", r"$\lambda_1$ [bits/s]", rate))
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
        line = _draw_boundary(axes[0], plan)
        figure.legend(handles=met + line, loc="outside lower center", ncols=len(met) + len(line))
        for place, (title, label, values) in zip(axes[1:], panels, strict=True):
            norm = None
            style: dict[str, Any] = {"cmap": "viridis"}
            if title in (distance, swing):
                least = 1e-10 * factor  # a tenth of a nanometre is no motion
                finite = values[np.isfinite(values) & (values > 0)]
                if len(finite):
                    norm = LogNorm(max(finite.min(), least), max(finite.max(), 10 * least))
                values = np.maximum(values, least)
            else:
                known = np.abs(values[np.isfinite(values)])
                bound = (float(np.percentile(known, 99)) if len(known) else 0.0) or 1.0
                values = np.maximum(values, -bound)  # minus infinity, too
                style = {"cmap": "PuOr", "vmin": -bound, "vmax": bound}
            image = place.pcolormesh(xs, ys, values, norm=norm, rasterized=True, **style)
            figure.colorbar(image, ax=place, label=label.strip())
            place.set_title(title)
            _draw_boundary(place, plan)
        for place in axes:
            place.set_xlabel(_label(plan, plan.x.name))
            place.ticklabel_format(useOffset=False, axis="both")
            place.tick_params(axis="x", rotation=30)
        axes[0].set_ylabel(_label(plan, plan.y.name))
    return figure


def _label(plan: MapPlan, name: str) -> str:
    from .map_plan import axis_unit

    unit = axis_unit(plan, name)
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def _draw_boundary(axes: Any, plan: MapPlan) -> list[Any]:
    """The line on which the loop, while stuck, neither falls nor grows."""
    from matplotlib.lines import Line2D

    from .cell import stuck_growth
    from .map_plan import DESIGN, kernel_of

    if plan.fmus is not None:
        return []  # an FMU gives no Jacobian of the whole loop
    if PLANT + "Kv" not in [p.name for p in kernel_of(plan).parameters]:
        return []  # the criterion is one of friction with a smooth sign
    if DESIGN in (plan.x.side, plan.y.side):
        return []  # a design for each of its points would take longer than the map
    if kernel_of(plan).sample_time:
        return []  # the criterion is one of continuous feedback
    xs = np.linspace(plan.x.low, plan.x.high, _BOUNDARY_POINTS)
    ys = np.linspace(plan.y.low, plan.y.high, _BOUNDARY_POINTS)
    growth = np.array([[stuck_growth(plan, float(x), float(y)) for x in xs] for y in ys])
    label = "limit of stability while the block is stuck (Routh-Hurwitz)"
    if not (growth.min() < 0.0 < growth.max()):
        return []
    axes.contour(xs, ys, growth, levels=[0.0], colors="black", linewidths=1.6, linestyles="--")
    return [Line2D([], [], color="black", ls="--", lw=1.6, label=label)]
