"""The picture of a comparison: position, force and friction, measured and by each model."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ...orchestration.loop.pictures import COLOURS, DASHES, STYLE, new_figure
from ...orchestration.loop.shown import shown_unit
from ...solver.arrays import Vector
from .compared import MODEL, Compared

_MOST_POINTS = 6000
_SHOWN = (0.002, 0.998)  # quantiles of a curve at the lower and upper end of a picture
_MEASURED, _REST = "#000000", "#e8e8e8"


def compare_figure(found: Compared) -> Any:
    """Position, its error and the force over time, and friction over velocity."""
    import matplotlib as mpl

    t = found.traces
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(3, 2, (14, 9))
        (position, _), (off, _), (force, _) = grid
        for axes in (off, force):
            axes.sharex(position)
        spec = grid[0][1].get_gridspec()
        spec.set_width_ratios([1.5, 1])
        for axes in grid[:, 1]:
            axes.remove()
        over_velocity = figure.add_subplot(spec[:, 1])
        figure.suptitle(found.says[0].upper() + found.says[1:], fontsize=12)

        errors = {n: x - t.x for n, x in t.predicted.items()}
        size, unit = shown_unit(np.concatenate([*errors.values(), np.zeros(1)]), "m")
        position.plot(t.time, 1e3 * t.x, color=_MEASURED, lw=2.6, label="measured")
        force.plot(t.time, t.required, color=_MEASURED, lw=1.2, label="required")
        some = np.flatnonzero(t.counted)
        some = some[:: max(1, len(some) // _MOST_POINTS)]
        over_velocity.plot(
            1e3 * t.v[some],
            t.required[some],
            ".",
            ms=2.5,
            color=COLOURS[5],
            label="record, while moving",
            rasterized=True,
        )
        for k, (name, left) in enumerate(t.left.items()):
            style = {"color": COLOURS[(1, 4, 0)[k]], "ls": DASHES[k], "lw": 1.3}
            label = name if name == MODEL else f"{name} model"
            if name in errors:
                position.plot(
                    t.time, _broken(1e3 * t.predicted[name], t.starts), label=label, **style
                )
                off.plot(t.time, _broken(size * errors[name], t.starts), label=label, **style)
            force.plot(t.time, t.required - left, label=label, **style)
            v, friction = t.curves[name]
            over_velocity.plot(1e3 * v, friction, label=label, **{**style, "lw": 2.0})
        position.set_ylabel("position [mm]")
        position.set_title("Position", loc="left")
        off.set_ylabel(f"error [{unit}]")
        grey = "; grey: at rest" if t.rests.any() else ""
        off.set_title(
            f"Predicted minus measured position, each second from the recorded state{grey}",
            loc="left",
        )
        force.set_ylabel("force [N]")
        force.set_title("Force against the motion", loc="left")
        force.set_xlabel("time [s]")
        over_velocity.set_xlabel("velocity [mm/s]")
        over_velocity.set_ylabel("friction [N]")
        over_velocity.set_title("Friction over velocity", loc="left")
        _scaled(force, t.required)
        _scaled(
            over_velocity, np.concatenate([t.required[some], *(f for _, f in t.curves.values())])
        )
        for axes in (position, off, force):
            for begin, end in _rests(found):
                axes.axvspan(begin, end, color=_REST, lw=0, zorder=0)
        for axes in (position, force):
            axes.legend(
                loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=4, fontsize=9, handlelength=1.6
            )
        over_velocity.legend(loc="upper left", fontsize=9)
    return figure


def _broken(values: Vector, starts: npt.NDArray[np.bool_]) -> Vector:
    """The line with a gap before each second, where the prediction starts again."""
    return np.where(np.append(starts[1:], False), np.nan, values)


def _rests(found: Compared) -> list[tuple[float, float]]:
    """Start and end of each rest [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], found.traces.rests, [0]])))
    time = found.traces.time
    return [
        (float(time[a]), float(time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _scaled(axes: Any, values: Vector) -> None:
    """Set limits that show nearly all values; a jump of friction makes a few samples large."""
    low, high = np.quantile(values, _SHOWN)
    room = 0.1 * max(high - low, 1e-9)
    axes.set_ylim(low - room, high + room)
