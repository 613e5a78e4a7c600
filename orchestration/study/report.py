"""A study as one page that opens without a network."""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING, Any

from ..page import layout, page
from .figures import UNITS
from .lengths import length, scale
from .pictures import COLOURS, mark_of
from .result import JUDGED_BY, MEASURED
from .verdict import sentence, weaknesses

if TYPE_CHECKING:
    from .result import StudyResult

_SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x")
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot", "5px 1px 1px 1px")
_FAR_OFF = (
    30.0  # times the median of the largest errors: a larger course is drawn only if requested
)


def report(study: StudyResult) -> str:
    """The page as text; its headline gives the winner, and the line below the limitations."""
    duties = [d.name for d in study.plan.judged_duties]
    figures = [
        _error_over_duties(study),
        *(course for d in duties for course in _courses(study, d)),
        *(_error_against_effort(study, d) for d in duties),
    ]
    return page(
        __package__,
        "report.html.jinja",
        figures,
        {"number": number, "metres": length},
        figures=figures,
        study=study,
        headline=sentence(study),
        weaknesses=weaknesses(study),
        plan=study.plan,
        duties=duties,
        names=[e.name for e in study.plan.entrants],
        answers=study.answers,
        shown={d: [(n, *_scale(study, n, d)) for n in MEASURED] for d in duties},
    )


def number(value: float) -> str:
    """Three digits; "never" if a time is infinite, a dash if there is no value."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.3g}"


def _scale(study: StudyResult, figure: str, duty: str) -> tuple[float, str]:
    """Factor of a column of the table, and its unit."""
    if UNITS[figure] != "m":
        return 1.0, UNITS[figure]
    return scale(study.interval(figure, e.name, duty).mean for e in study.plan.entrants)


def _trace(k: int, name: str, **data: Any) -> dict[str, Any]:
    marker = {"symbol": _SYMBOLS[mark_of(k)], "size": 9}
    trace = {"type": "scatter", "mode": "markers", "name": name, "meta": _colour(k)}
    return trace | {"marker": marker, **data}


def _colour(k: int) -> str:
    return f"c{k % len(COLOURS)}"


def _error_over_duties(study: StudyResult) -> dict[str, Any]:
    duties = [d.name for d in study.plan.judged_duties]

    def errors(name: str) -> list[float | None]:
        return [_plain(1e6 * study.mean(JUDGED_BY, name, duty)) for duty in duties]

    traces = [
        _trace(k, e.name, x=duties, y=errors(e.name)) for k, e in enumerate(study.plan.entrants)
    ]
    y = {"type": "log", "title": {"text": "rms error [um]"}}
    return {
        "name": "errors",
        "title": "Error at each duty",
        "says": "Geometric mean over all plants and tunings.",
        "data": traces,
        "layout": layout({"type": "category"}, y),
    }


def _courses(study: StudyResult, duty: str) -> list[dict[str, Any]]:
    """Position error and command over time, of all controllers on the nominal plant."""
    place = [d.name for d in study.plan.judged_duties].index(duty)
    courses = {n: c for n, c in study.courses.get(duty, {}).items() if c.time}
    peaks = {n: max(map(abs, course.error)) for n, course in courses.items()}
    factor, unit = scale(peaks.values())
    far = {n for n, p in peaks.items() if p > _FAR_OFF * statistics.median(peaks.values())}
    hidden = (
        " Hidden until you click on its name, since it is far from the others: "
        f"{', '.join(sorted(far))}."
        if far
        else ""
    )

    def figure(name: str, title: str, axis: str, values: Any) -> dict[str, Any]:
        traces = []
        for k, entrant in enumerate(study.plan.entrants):
            if entrant.name not in courses:
                continue
            trace: dict[str, Any] = {
                "type": "scatter",
                "mode": "lines",
                "name": entrant.name,
                "meta": _colour(k),
                "line": {"dash": dash_of(k), "width": 1.5},
                "x": courses[entrant.name].time,
                "y": values(courses[entrant.name]),
            }
            if entrant.name in far:
                trace["visible"] = "legendonly"
            traces.append(trace)
        return {
            "name": f"{name}{place}",
            "title": f"{title}: {duty}",
            "says": "On the nominal plant, each with its best tuning." + hidden,
            "data": traces,
            "layout": layout({"title": {"text": "time [s]"}}, {"title": {"text": axis}}),
        }

    errors = f"set-point minus position [{unit}]"
    return [
        figure("course", "Error over time", errors, lambda c: [factor * e for e in c.error]),
        figure(
            "command", "Command over time", f"command [{study.command_unit}]", lambda c: c.command
        ),
    ]


def dash_of(number: int) -> str:
    """The dash of a controller's line: solid for the first of each colour."""
    return _DASHES[number // len(COLOURS) % len(_DASHES)]


def _error_against_effort(study: StudyResult, duty: str) -> dict[str, Any]:
    traces = [
        _trace(
            k,
            e.name,
            x=[_plain(study.mean("total_variation", e.name, duty))],
            y=[_plain(1e6 * study.mean(JUDGED_BY, e.name, duty))],
        )
        for k, e in enumerate(study.plan.entrants)
    ]
    x = {"type": "log", "title": {"text": f"total variation of the command [{study.command_unit}]"}}
    y = {"type": "log", "title": {"text": "rms error [um]"}}
    return {
        "name": f"effort{[d.name for d in study.plan.judged_duties].index(duty)}",
        "title": f"Error against effort: {duty}",
        "says": "Points further down and to the left are better. Missing points are failed runs.",
        "data": traces,
        "layout": layout(x, y),
    }


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
