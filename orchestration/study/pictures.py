"""Pictures of a study: error against effort, and courses of error and command, for each duty."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING, Any

from ..loop.pictures import STYLE, new_figure
from .lengths import scale
from .result import JUDGED_BY

if TYPE_CHECKING:
    from .result import StudyResult

# after Okabe and Ito: colours that colour-blind readers can distinguish; then with other marks
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
FEW_DECADES = 60.0  # ratio of the ends of an axis
FAR = 30.0  # times the median of the largest errors: a larger course is left out
DASHES = ("-", "--", ":", "-.", (0, (8, 2)), (0, (8, 2, 1, 2)), (0, (5, 1, 1, 1)))
MARKS = ("o", "s", "^", "D", "v", "P", "X")


def _label(axis: Any) -> None:
    """Plain numbers at 1, 2, 5 of each decade; with many decades only at 1."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < FEW_DECADES else (1,)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def mark_of(number: int) -> int:
    """Number of a controller's mark: no two of 49 have the same mark and the same colour."""
    return (number + number // len(COLOURS)) % len(MARKS)


def dash_of(number: int) -> Any:
    """The dash of a controller's line: solid for the first of each colour."""
    return DASHES[number // len(COLOURS) % len(DASHES)]


def courses_figure(study: StudyResult) -> Any:
    """Position error and command of each controller with its best tuning on the nominal plant."""
    import matplotlib as mpl

    duties = [d.name for d in study.plan.judged_duties]
    with mpl.rc_context(STYLE):
        figure, panels = new_figure(len(duties), 2, (10, 2.8 * len(duties) + 0.8))
        for (errors, commands), duty in zip(panels, duties, strict=True):
            courses = {n: c for n, c in study.courses.get(duty, {}).items() if c.time}
            peaks = {n: max(map(abs, course.error)) for n, course in courses.items()}
            far = {n for n, p in peaks.items() if p > FAR * statistics.median(peaks.values())}
            factor, unit = scale(peaks.values())
            for k, name in enumerate(e.name for e in study.plan.entrants):
                course = courses.get(name)
                style = {"color": COLOURS[k % len(COLOURS)], "ls": dash_of(k), "lw": 1.3}
                if course is None or name in far:
                    errors.plot([], [], label=name, **style)
                    continue
                errors.plot(course.time, [factor * e for e in course.error], label=name, **style)
                commands.plot(course.time, course.command, **style)
            left_out = f" (far off: {', '.join(sorted(far))})" if far else ""
            errors.set_title(f"{duty}{left_out}", loc="left")
            errors.set_ylabel(f"error [{unit}]")
            commands.set_ylabel(f"command [{study.command_unit}]")
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))
    return figure


def effort_figure(study: StudyResult) -> Any:
    """Error [um] against total variation of the command [V], both on logarithmic axes."""
    from matplotlib.figure import Figure

    duties = [d.name for d in study.plan.judged_duties]
    columns = min(3, len(duties))
    rows = -(-len(duties) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.4 * rows + 0.8), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, duty in zip(panels, duties, strict=False):
        for k, entrant in enumerate(study.plan.entrants):
            panel.loglog(
                study.mean("total_variation", entrant.name, duty),
                1e6 * study.mean(JUDGED_BY, entrant.name, duty),
                marker=MARKS[mark_of(k)],
                color=COLOURS[k % len(COLOURS)],
                linestyle="none",
                label=entrant.name,
            )
        panel.set_title(duty, fontsize=10)
        panel.set_xlabel(f"total variation of the command [{study.command_unit}]")
        panel.set_ylabel("rms error [$\\mu$m]")
        panel.grid(True, which="major", alpha=0.3)
        for axis in (panel.xaxis, panel.yaxis):
            _label(axis)
    for panel in panels[len(duties) :]:
        panel.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))
    return figure
