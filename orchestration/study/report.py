"""Tables and pictures of a study, and pictures of a tuning."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..loop.pictures import COLOURS, DASHES, styled_figure
from ..loop.shown import Table, length, shown_unit
from .result import ALIKE, StudyResult
from .run import JUDGED_BY, MEASURED, UNITS

if TYPE_CHECKING:
    from .tune import TunedController

FAR = 30.0  # times the median of the largest errors: a larger course is left out
MARKS = ("o", "s", "^", "D", "v", "P", "X")
_MEANS = (
    "Means over plants and tunings, and their 90 % intervals over plants and noise, after Student. "
    "Geometric means for errors, energy, current and variation. The luck of a tuning is not in "
    "these intervals; it is in those of the differences. A dash: not in every run. Hunting is "
    "judged in the last quarter of the last rest; a longer cycle is not seen."
)
_COSTS = (
    "Cost: mean of the rms error over the size of the motion, and penalties beyond the limits. "
    "A controller with fewer parameters tunes faster: compare the last two costs."
)


def tables_of(study: StudyResult) -> list[Table]:
    """Answers, figures, differences and tunings."""
    duties = [d.name for d in study.plan.judged_duties]
    figures = (_figures(study, duty, "" if k else _MEANS) for k, duty in enumerate(duties))
    return [_answers(study), *figures, *_differences(study), _tunings(study)]


def _answers(study: StudyResult) -> Table:
    """The best controller of each duty, and how far the runs over FMUs agree."""
    rows = []
    for a in study.answers:
        failed = ", ".join(f"{n}: {count}" for n, count in a.failed.items() if count)
        best = "-"
        if a.order:
            best = f"{a.order[0]} ({length(study.mean(JUDGED_BY, a.order[0], a.duty).mean)} rms)"
        others = (", ".join(a.best[1:]) or "-", ", ".join(a.unclear) or "-", failed or "none")
        rows.append((a.duty, best, *others))
    plan = study.plan
    worst = max((c.apart for c in study.checks.values() if c.apart >= 0), default=0.0)
    duties = ", ".join(d.name for d in plan.tuning_duties)
    says = (
        f"Each controller was tuned {plan.tuning.seeds} times with {plan.tuning.budget} candidates "
        f"on {duties}, on the nominal plant and {plan.tuning.plants} drawn ones, then judged on "
        f"{plan.plants} other plants and on motions that no tuning has seen. All are simulated: "
        f"how a real axis differs is not said here. Repeated over FMUs: {len(study.checks)} "
        f"runs, drawn at random, at most {length(worst)} apart; {study.disagreed} came out "
        f"differently, and the coupling of {study.not_converged} is not converged."
    )
    same = f"equal to it within {100 * ALIKE:g} %"
    columns = ("duty", "smallest error", same, study.cannot_tell, "failed runs")
    return Table("Which controller for which duty", columns, rows, says=says)


def number(value: float) -> str:
    """Three digits; "never" if a time is infinite, a dash if there is no value."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.3g}"


def _figures(study: StudyResult, duty: str, says: str) -> Table:
    names = [e.name for e in study.plan.entrants]
    titles, columns = ["controller"], [names]
    for figure in MEASURED:
        means = [study.mean(figure, name, duty) for name in names]
        factor, unit = 1.0, UNITS[figure]
        if unit == "m":
            sizes = [m.mean for m in means if math.isfinite(m.mean)]
            factor, unit = shown_unit(statistics.median(sizes or [0.0]), unit)
        cells = []
        for m in means:
            ends = f" ({number(factor * m.low)} to {number(factor * m.high)})"
            cells.append(number(factor * m.mean) + ends * (m.low < m.high))
        titles.append(f"{figure.replace('_', ' ')} [{unit}]")
        columns.append(cells)
    hunts = []
    for said in (study.hunting(name, duty) for name in names):
        undecided = f", {said['undecided']} undecided" if said["undecided"] else ""
        hunts.append(f"{said['hunting']} of {sum(said.values())}{undecided}")
    rows = list(zip(*columns, hunts, strict=True))
    return Table(f"Figures: {duty}", (*titles, "hunts"), rows, says=says)


def _differences(study: StudyResult) -> Iterator[Table]:
    columns = ("first", "second", "ratio of rms errors", "90 % interval", "")
    for duty, pairs in study.differences.items():
        rows = [
            (*pair, number(d.ratio), f"{number(d.low)} to {number(d.high)}", d.words)
            for pair, d in pairs.items()
        ]
        yield Table(f"Differences: {duty}", columns, rows)


def _tunings(study: StudyResult) -> Table:
    rows = []
    for name, found in study.tunings.items():
        for t in found:
            costs = map(number, (t.published_cost, t.cost, t.doubled_cost))
            rows.append((name, *costs, ", ".join(t.at_bound)))
    names = ("cost of the published rule", "tuned", "with twice the budget")
    columns = ("controller", *names, "at the end of its range")
    return Table("Tuning", columns, rows, says=_COSTS)


def _legend_below(figure: Any, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))


def courses_figure(study: StudyResult) -> Any:
    """Position error and command of each controller with its best tuning on the nominal plant."""
    count = len(study.courses)
    with styled_figure(count, 2, (10, 2.8 * count + 0.8)) as (figure, panels):
        for (errors, commands), (duty, courses) in zip(panels, study.courses.items(), strict=True):
            peaks = {n: max(map(abs, c.error)) for n, c in courses.items() if c.time}
            usual = statistics.median(peaks.values() or [0.0])
            far = sorted(n for n, peak in peaks.items() if peak > FAR * usual)
            factor, unit = shown_unit(usual, "m")
            for k, (name, course) in enumerate(courses.items()):
                time, error, command = (np.array([] if name in far else s) for s in course)
                dash = DASHES[k // len(COLOURS) % len(DASHES)]
                style = {"color": COLOURS[k % len(COLOURS)], "ls": dash, "lw": 1.3}
                errors.plot(time, factor * error, label=name, **style)
                commands.plot(time, command, **style)
            left_out = f" (far off: {', '.join(far)})" if far else ""
            errors.set_title(f"{duty}{left_out}", loc="left")
            errors.set_ylabel(f"error [{unit}]")
            commands.set_ylabel(f"command [{study.plan.command_unit}]")
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")
        _legend_below(figure, panels[0][0])
    return figure


def effort_figure(study: StudyResult) -> Any:
    """Error [um] against total variation of the command, both on logarithmic axes."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    duties = list(study.differences)
    columns = min(3, len(duties))
    rows = -(-len(duties) // columns)
    with styled_figure(rows, columns, (4.2 * columns, 3.4 * rows + 0.8)) as (figure, axes):
        for panel in axes.flat[len(duties) :]:
            panel.set_axis_off()
        for panel, duty in zip(axes.flat, duties, strict=False):
            for k, name in enumerate(study.tunings):
                effort = study.mean("total_variation", name, duty).mean
                error = 1e6 * study.mean(JUDGED_BY, name, duty).mean
                mark = MARKS[(k + k // len(COLOURS)) % len(MARKS)]  # 49 differ in mark or colour
                colour = COLOURS[k % len(COLOURS)]
                panel.loglog(effort, error, label=name, marker=mark, color=colour, ls="none")
            panel.set_title(duty)
            panel.set_xlabel(f"total variation of the command [{study.plan.command_unit}]")
            panel.set_ylabel("rms error [µm]")
            for axis in (panel.xaxis, panel.yaxis):  # plain numbers at 1, 2, 5; of many decades 1
                low, high = axis.get_view_interval()
                axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < 60 else (1,)))
                axis.set_major_formatter(FormatStrFormatter("%g"))
                axis.set_minor_locator(NullLocator())
        _legend_below(figure, axes[0, 0])
    return figure


def motions_figure(tuned: TunedController) -> Any:
    """Position, error and command of each motion, one column each."""
    count = len(tuned.motions)
    with styled_figure(3, count, (4.2 * count, 7.5)) as (figure, axes):
        for (position, error, command), motion in zip(axes.T, tuned.motions, strict=True):
            course = motion.course
            shown = len(course.position)  # none of a run that failed
            time, goal = course.time[:shown], course.reference[:shown]
            position.set_title(f"{motion.duty.name}, {'' if motion.duty.tune else 'not '}tuned on")
            position.plot(time, 1e3 * goal, color=COLOURS[1], ls=DASHES[1], label="set-point")
            position.plot(time, 1e3 * course.position, color=COLOURS[0], label="position")
            error.plot(time, 1e6 * (goal - course.position), color=COLOURS[0])
            command.plot(time, course.command, color=COLOURS[0], label="command")
            for sign, label in ((1, "limit"), (-1, None)):
                command.axhline(sign * tuned.limit, color=COLOURS[6], ls=DASHES[3], label=label)
            command.set_xlabel("time [s]")
        labels = "position [mm]", "error [µm]", f"command [{tuned.plan.command_unit}]"
        for axis, label in zip(axes[:, 0], labels, strict=True):
            axis.set_ylabel(label)
        axes[0, 0].legend()
        axes[2, 0].legend()
    return figure


def bode_figure(tuned: TunedController) -> Any:
    """Gain and phase of the open loop, and the sensitivity, stuck and sliding."""
    with styled_figure(3, 1, (8, 9)) as (figure, ((gain,), (phase,), (sensitivity,))):
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
        sensitivity.set_ylim(bottom=1e-3)
        sensitivity.set_xlabel("frequency [Hz]")
        labels = "gain of the open loop", "phase [degrees]", "sensitivity |1/(1 + L)|"
        for axis, label in zip((gain, phase, sensitivity), labels, strict=True):
            axis.set_ylabel(label)
        gain.set_title(f"{tuned.loop.title}, broken at the command")
        gain.legend()
        figure.align_ylabels()
    return figure
