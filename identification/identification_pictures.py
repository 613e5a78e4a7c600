"""Pictures of an identification: the friction map with the fit, and what the fit leaves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..orchestration.pictures import COLOURS, STYLE, drawing, new_figure, write_figure

if TYPE_CHECKING:
    from .identification import Identification

_MOST_POINTS = 6000


@drawing()
def save_pictures(result: Identification, folder: Path) -> None:
    """Write ``friction_map`` and ``residuals`` into `folder`."""
    for stem, figure in identification_figures(result).items():
        write_figure(figure, folder, stem)


def identification_figures(result: Identification) -> dict[str, Any]:
    """Figures of friction over velocity and of what the fit leaves, by name."""
    import matplotlib as mpl

    figures = {}

    course, fit = result.course, result.fit
    open_ones = [n for n, i in result.parameters.items() if not i.identified]
    word = "identified" if result.trusted else "not trusted"
    if len(open_ones) == len(result.warnings) > 0:
        word = "all but " + ", ".join(open_ones)
    title = f"{result.law} from {len(result.records)} records: {word}"
    measured = course.force - course.inertial
    friction = fit.predicted - course.inertial
    with mpl.rc_context(STYLE):
        figure, ((over_velocity, over_way),) = new_figure(1, 2, (11, 4.6))
        some = slice(None, None, max(1, len(course.x) // _MOST_POINTS))
        _scatter(over_velocity, 1e3 * course.v[some], measured[some], friction[some])
        still = result.points.velocity == 0
        for kind, marker, label in (
            (still, "v", "largest force held"),
            (~still, "D", "mean at constant velocity"),
        ):
            if np.any(kind):
                over_velocity.plot(
                    1e3 * result.points.velocity[kind],
                    result.points.friction[kind],
                    marker,
                    color=COLOURS[6],
                    mfc="none",
                    ms=7,
                    label=label,
                )
        over_velocity.set_xlabel("velocity [mm/s]")
        over_velocity.set_ylabel("friction [N]")
        over_velocity.set_title(title)
        over_velocity.legend(loc="best", fontsize=9)
        begin = course.x[course.starts[:-1]][course.of_record()]
        way = 1e6 * (course.x - begin)
        near = np.abs(way) < 100
        _scatter(over_way, way[near], measured[near], friction[near])
        over_way.set_xlabel("displacement from the start [µm]")
        over_way.set_ylabel("friction [N]")
        over_way.set_title("Presliding")
        figures["friction_map"] = figure

        figure, grid = new_figure(2, 1, (9, 6))
        course_axes, histogram = grid[0][0], grid[1][0]
        residual = course.force - fit.predicted
        for r in range(course.records):
            part = slice(course.starts[r], course.starts[r + 1])
            time = course.step[r] * np.arange(course.starts[r + 1] - course.starts[r])
            course_axes.plot(
                time, residual[part], lw=0.6, color=COLOURS[r % len(COLOURS)], rasterized=True
            )
        course_axes.set_xlabel("time in the record [s]")
        course_axes.set_ylabel("force less fit [N]")
        course_axes.set_title(title)
        spread = max(4 * float(residual.std()), 1e-9)
        histogram.hist(
            residual, bins=80, range=(-spread, spread), color=COLOURS[0], alpha=0.8, density=True
        )
        histogram.set_xlabel("force less fit [N]")
        histogram.set_ylabel("density [1/N]")
        figures["residuals"] = figure
    return figures


def _scatter(axes: Any, where: Any, measured: Any, friction: Any) -> None:
    style = {"ls": "none", "rasterized": True}
    axes.plot(where, measured, ".", ms=2.5, color=COLOURS[5], label="measured", **style)
    axes.plot(where, friction, ".", ms=1.5, color=COLOURS[1], label="fit", **style)
