"""A study as tables, for its page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from statistics import median
from typing import TYPE_CHECKING

from ..loop.shown import Table, length, shown_unit
from .figures import UNITS
from .result import JUDGED_BY, MEASURED, cannot_tell
from .statistics import ALIKE

if TYPE_CHECKING:
    from .result import StudyResult

_MEANS = (
    "Means over plants and tunings, and their 90 % intervals over plants and noise, after Student. "
    "Geometric means for errors, energy, current and variation, of which the logarithm was taken. "
    "The luck of a tuning is not in these intervals; it is in those of the differences. A dash: "
    "not defined, or not in every run. A run hunts that goes to and fro in the last quarter of its "
    "last rest, two whole times or more, with an amplitude of more than a count of the position "
    "sensor; it is undecided where it neither does nor stays within a count. A cycle longer than "
    "that rest is not seen."
)


def tables_of(study: StudyResult) -> list[Table]:
    """Winners, figures, differences, tunings and sensitivities."""
    return [
        answers(study),
        *_figures(study),
        *_differences(study),
        _tunings(study),
        _sensitivities(study),
    ]


def answers(study: StudyResult) -> Table:
    """The best controller of each duty, and how far the runs over FMUs agree."""
    rows = []
    for a in study.answers:
        failed = ", ".join(f"{n}: {count}" for n, count in a.failed.items() if count)
        best = "-"
        if a.order:
            best = f"{a.order[0]} ({length(study.mean(JUDGED_BY, a.order[0], a.duty))} rms)"
        others = (", ".join(a.best[1:]) or "-", ", ".join(a.unclear) or "-", failed or "none")
        rows.append((a.duty, best, *others))
    plan = study.plan
    worst = max((c.apart for c in study.checks.values() if c.apart >= 0), default=0.0)
    duties = ", ".join(d.name for d in plan.tuning_duties)
    says = (
        f"Each controller was tuned {plan.tuning.seeds} times with a budget of "
        f"{plan.tuning.budget} candidates on {duties}, on the nominal plant and "
        f"{plan.tuning.plants} drawn ones, then judged on {plan.plants} other plants and on "
        "motions that no tuning has seen. "
        + (f"Sampled every {number(1e3 * plan.period)} ms. " if plan.period > 0 else "")
        + "Simulated plants: how a real axis differs from them is not in these figures. "
        f"Repeated over FMUs: {len(study.checks)} runs, drawn at random, at most {length(worst)} "
        f"apart; {study.disagreed} came out differently, and the coupling of "
        f"{study.not_converged} is not converged."
    )
    columns = (
        *("duty", "smallest error", f"equal to it within {100 * ALIKE:g} %"),
        *(cannot_tell(study), "failed runs"),
    )
    return Table("Which controller for which duty", columns, rows, says=says)


def number(value: float) -> str:
    """Three digits; "never" if a time is infinite, a dash if there is no value."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.3g}"


def _figures(study: StudyResult) -> Iterator[Table]:
    names = [e.name for e in study.plan.entrants]
    for duty in (d.name for d in study.plan.judged_duties):
        scales = {n: (1.0, UNITS[n]) for n in MEASURED}
        for n in (n for n in MEASURED if UNITS[n] == "m"):
            means = [study.interval(n, name, duty).mean for name in names]
            scales[n] = shown_unit(median([*filter(math.isfinite, means)] or [0.0]), "m")
        rows = []
        for name in names:
            hunts = study.hunting(name, duty)
            cells = []
            for figure, (factor, _) in scales.items():
                m = study.interval(figure, name, duty)
                ends = f" ({number(factor * m.low)} to {number(factor * m.high)})"
                cells.append(number(factor * m.mean) + (ends if m.low < m.high else ""))
            undecided = f", {hunts['undecided']} undecided" if hunts["undecided"] else ""
            rows.append((name, *cells, f"{hunts['hunting']} of {sum(hunts.values())}{undecided}"))
        titles = [f"{n.replace('_', ' ')} [{unit}]" for n, (_, unit) in scales.items()]
        says = _MEANS if duty == study.plan.judged_duties[0].name else ""
        yield Table(f"Figures: {duty}", ("controller", *titles, "hunts"), rows, says=says)


def _differences(study: StudyResult) -> Iterator[Table]:
    columns = ("first", "second", "ratio of rms errors", "90 % interval", "")
    for duty in (d.name for d in study.plan.judged_duties):
        rows = [
            (*pair, number(d.ratio), f"{number(d.low)} to {number(d.high)}", d.words)
            for pair, d in study.differences[duty].items()
        ]
        yield Table(f"Differences: {duty}", columns, rows)


def _tunings(study: StudyResult) -> Table:
    columns = (
        *("controller", "cost of the published rule", "tuned", "with twice the budget"),
        "at the end of its range",
    )
    rows = [
        (name, *map(number, (t.published_cost, t.cost, t.doubled_cost)), ", ".join(t.at_bound))
        for name, found in study.tunings.items()
        for t in found
    ]
    says = (
        "Cost: mean of the rms error over the size of the motion, and penalties beyond the limits. "
        "A controller with fewer parameters tunes faster: compare the last two costs."
    )
    return Table("Tuning", columns, rows, says=says)


def _sensitivities(study: StudyResult) -> Table:
    rows = [
        (
            name,
            s.foremost or "-",
            " ".join(f"{n}: {number(c)}" for n, c in s.coefficients.items()),
            f"{number(100 * s.explained)} %",
        )
        for name, s in study.sensitivities.items()
    ]
    columns = ("controller", "foremost", "coefficients", "variance explained")
    return Table("What each is most sensitive to", columns, rows)
