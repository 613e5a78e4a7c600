"""A study as one page that opens without a network."""

from __future__ import annotations

import math
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from .figures import UNITS
from .pictures import COLOURS, mark_of
from .result import JUDGED_BY, MEASURED

if TYPE_CHECKING:
    from .result import StudyResult

_SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x")


def report(study: StudyResult, headline: str) -> str:
    """The page as text; its headline says what weakens the result."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    made = Environment(
        loader=PackageLoader(__package__, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    made.filters["number"] = number
    duties = [d.name for d in study.plan.judged_duties]
    return made.get_template("report.html.jinja").render(
        study=study,
        headline=headline,
        plan=study.plan,
        duties=duties,
        names=[e.name for e in study.plan.entrants],
        answers=study.answers,
        shown=[(n, UNITS[n]) for n in MEASURED],
        figures=[_error_over_duties(study), *(_error_against_effort(study, d) for d in duties)],
        plotly=get_plotlyjs(),
        version=version("ballscrew"),
    )


def number(value: float) -> str:
    """Three digits; "never" where a time is infinite, a dash where there is none."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.3g}"


def _trace(k: int, name: str, **data: Any) -> dict[str, Any]:
    marker = {
        "color": COLOURS[k % len(COLOURS)],
        "symbol": _SYMBOLS[mark_of(k)],
        "size": 9,
    }
    return {"type": "scatter", "mode": "markers", "name": name, "marker": marker, **data}


def _layout(x: dict[str, Any], y: dict[str, Any]) -> dict[str, Any]:
    return {
        "xaxis": {"automargin": True, **x},
        "yaxis": {"automargin": True, **y},
        "margin": {"t": 10, "r": 10},
        "legend": {"orientation": "h", "y": -0.25},
    }


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
        "layout": _layout({"type": "category"}, y),
    }


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
    x = {"type": "log", "title": {"text": "total variation of the command [V]"}}
    y = {"type": "log", "title": {"text": "rms error [um]"}}
    return {
        "name": f"effort{[d.name for d in study.plan.judged_duties].index(duty)}",
        "title": f"Error against effort: {duty}",
        "says": "Down and to the left is better. What is missing failed.",
        "data": traces,
        "layout": _layout(x, y),
    }


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
