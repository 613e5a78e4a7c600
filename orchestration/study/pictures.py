"""Pictures of a study: error against effort, courses; of a tuning: motions, frequency response."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING, Any

import numpy as np

from ..loop.pictures import COLOURS, DASHES, STYLE, new_figure
from ..loop.shown import shown_unit
from .result import JUDGED_BY

if TYPE_CHECKING:
    from .result import StudyResult
    from .tune import TunedController

FEW_DECADES = 60.0  # ratio of the ends of an axis
FAR = 30.0  # times the median of the largest errors: a larger course is left out
MARKS = ("o", "s", "^", "D", "v", "P", "X")


def _label(axis: Any) -> None:
    """Plain numbers at 1, 2, 5 of each decade; with many decades only at 1."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < FEW_DECADES else (1,)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def _legend_below(figure: Any, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))


def courses_figure(study: StudyResult) -> Any:
    """Position error and command of each controller with its best tuning on the nominal plant."""
    import matplotlib as mpl

    duties = [d.name for d in study.plan.judged_duties]
    with mpl.rc_context(STYLE):
        figure, panels = new_figure(len(duties), 2, (10, 2.8 * len(duties) + 0.8))
        for (errors, commands), duty in zip(panels, duties, strict=True):
            courses = {n: c for n, c in study.courses.get(duty, {}).items() if c.time}
            peaks = {n: max(map(abs, course.error)) for n, course in courses.items()}
            usual = statistics.median(peaks.values() or [0.0])
            far = {n for n, p in peaks.items() if p > FAR * usual}
            factor, unit = shown_unit(usual, "m")
            for k, name in enumerate(e.name for e in study.plan.entrants):
                course = courses.get(name)
                dash = DASHES[k // len(COLOURS) % len(DASHES)]
                style = {"color": COLOURS[k % len(COLOURS)], "ls": dash, "lw": 1.3}
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
        _legend_below(figure, panels[0][0])
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
                marker=MARKS[(k + k // len(COLOURS)) % len(MARKS)],  # 49 differ in mark or colour
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
    _legend_below(figure, panels[0])
    return figure


def motions_figure(tuned: TunedController) -> Any:
    """Position, error and command of each motion, one column each."""
    import matplotlib as mpl

    motions = tuned.motions
    with mpl.rc_context(STYLE):
        figure, axes = new_figure(3, len(motions), (4.2 * len(motions), 7.5))
        for k, motion in enumerate(motions):
            course = motion.course
            time = course.time[: len(course.position)]
            goal = course.reference[: len(time)]
            position, error, command = axes[:, k]
            words = "tuned on" if motion.tuned_on else "not tuned on"
            position.set_title(f"{motion.name}, {words}")
            position.plot(time, 1e3 * goal, color=COLOURS[1], ls=DASHES[1], label="set-point")
            position.plot(time, 1e3 * course.position, color=COLOURS[0], label="position")
            error.plot(time, 1e6 * (goal - course.position), color=COLOURS[0])
            command.plot(time, course.command[: len(time)], color=COLOURS[0], label="command")
            for sign in (1, -1):
                label = "limit" if sign > 0 else None
                command.axhline(sign * tuned.limit, color=COLOURS[6], ls=DASHES[3], label=label)
            command.set_xlabel("time [s]")
        axes[0, 0].set_ylabel("position [mm]")
        axes[1, 0].set_ylabel("error [µm]")
        axes[2, 0].set_ylabel(f"command [{tuned.command_unit}]")
        axes[0, 0].legend()
        axes[2, 0].legend()
    return figure


def bode_figure(tuned: TunedController) -> Any:
    """Gain and phase of the open loop, and the sensitivity, stuck and sliding."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, ((gain,), (phase,), (sensitivity,)) = new_figure(3, 1, (8, 9))
        for k, m in enumerate(tuned.margins):
            name = f"sliding at {m.speed:g} m/s" if m.speed else "stuck"
            style: dict[str, Any] = {"color": COLOURS[k], "ls": DASHES[k], "label": name}
            gain.loglog(m.frequency, np.abs(m.response), **style)
            angle = np.unwrap(np.angle(m.response))
            angle -= 2 * np.pi * np.ceil((angle[0] - np.pi / 4) / (2 * np.pi))  # -180, not 180
            phase.semilogx(m.frequency, np.degrees(angle), **style)
            sensitivity.loglog(m.frequency, np.abs(1 / (1 + m.response)), **style)
        gain.axhline(1, color="#555555", lw=0.8)
        phase.axhline(-180, color="#555555", lw=0.8)
        gain.set_ylabel("gain of the open loop")
        phase.set_ylabel("phase [degrees]")
        sensitivity.set_ylim(bottom=1e-3)
        sensitivity.set_ylabel("sensitivity |1/(1 + L)|")
        sensitivity.set_xlabel("frequency [Hz]")
        gain.set_title(f"{tuned.loop.title}, broken at the command")
        gain.legend()
        figure.align_ylabels()
    return figure
