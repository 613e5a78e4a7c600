"""A study in one sentence, and its limitations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import TYPE_CHECKING

from .comparison import ALIKE
from .result import JUDGED_BY

if TYPE_CHECKING:
    from .result import DutyAnswer, StudyResult

FAR = 2.0  # times the least known cost of a controller: a tuning that ends above it failed


def sentence(study: StudyResult) -> str:
    """The controller that wins the most duties, their number, and the duties that it does not win.

    A duty is won by the controller with the smallest error; the numbers of duties at which others
    are equal, and at which the runs cannot tell, are given.
    """
    judged = [a for a in study.answers if a.order]
    if not judged:
        return "No controller completed any duty"
    firsts = [a.order[0] for a in judged]
    # the most duties; of two with equal numbers, the one that is named first in the study
    winner = max((e.name for e in study.plan.entrants), key=firsts.count)
    won = [a for a in judged if a.order[0] == winner]
    text = f"{winner} wins {len(won)} of {len(study.answers)} duties"
    shared = [a.duty for a in won if len(a.best) > 1]
    if shared:
        text += f", {len(shared)} of them together with others, equal within {100 * ALIKE:g} %"
    unclear = [a.duty for a in won if a.unclear]
    if unclear:
        text += f"; at {len(unclear)} of them {cannot_tell(study)} whether others are as good"
    lost = [a for a in study.answers if a not in won]
    if lost:
        text += f"; it does not win {_listed(_by_winner(lost))}"
    return text


def cannot_tell(study: StudyResult) -> str:
    seeds, plants = study.plan.tuning.seeds, study.plan.plants
    return f"{seeds} tuning{'s' if seeds > 1 else ''} on {plants} plants cannot tell"


def _by_winner(answers: Iterable[DutyAnswer]) -> list[str]:
    by: dict[str, list[str]] = {}
    for a in answers:
        by.setdefault(a.order[0] if a.order else "", []).append(a.duty)
    return [
        f"{_listed(duties)} ({name} does)" if name else f"{_listed(duties)} (no controller does)"
        for name, duties in by.items()
    ]


def weaknesses(study: StudyResult) -> list[str]:
    """Limitations of the result, one sentence each; empty if there are none."""
    found = []
    failed = sum(sum(a.failed.values()) for a in study.answers)
    if failed:
        names = dict.fromkeys(n for a in study.answers for n, count in a.failed.items() if count)
        found.append(f"{failed} runs FAILED, of {_listed(list(names))}")
    if study.disagreed:
        found.append(f"{study.disagreed} of {len(study.checks)} runs DIFFER over FMUs")
    for name, costs in failed_tunings(study).items():
        least = least_cost(study, name)
        tried = len(study.tunings[name])
        found.append(
            f"tuning of {name} FAILED in {len(costs)} of {tried} tries: it ended at a cost of "
            f"{max(costs):.3g}, but {least:.3g} was found with more budget or another seed"
        )
    for name in untuned(study):
        found.append(f"tuning of {name} found no better values than the published ones")
    changed = overtaken(study)
    for name in dict.fromkeys(n for names in changed.values() for n in names):
        duties = [d for d, names in changed.items() if name in names]
        found.append(
            f"with more budget {name} might win {_listed(duties)}: twice the budget lowers its "
            f"cost to {100 * gain(study, name):.2g} %"
        )
    return found


def least_cost(study: StudyResult, name: str) -> float:
    """Least cost that any tuning of a controller found, also with twice the budget."""
    return min(t.doubled_cost for t in study.tunings[name])


def failed_tunings(study: StudyResult) -> dict[str, list[float]]:
    """Costs of the tunings that ended far above the least known cost, by controller."""
    ended = {
        name: [t.cost for t in tunings if t.cost > FAR * least_cost(study, name)]
        for name, tunings in study.tunings.items()
    }
    return {name: costs for name, costs in ended.items() if costs}


def untuned(study: StudyResult) -> list[str]:
    """Controllers with tuned parameters for which no tuning found a smaller cost."""
    asked = [e.name for e in study.plan.entrants if e.tune]
    return [n for n in asked if all(t.cost >= t.published_cost for t in study.tunings[n])]


def gain(study: StudyResult, name: str) -> float:
    """Cost with twice the budget over that with the budget: the median of the tunings."""
    return median(t.doubled_cost / t.cost if t.cost else 1.0 for t in study.tunings[name])


def overtaken(study: StudyResult) -> dict[str, tuple[str, ...]]:
    """By duty, the controllers that would win if errors fell like costs with twice the budget.

    Without those that are not shown to differ from the first one. Duties without a change are
    omitted.
    """
    found = {}
    for answer in study.answers:
        if not answer.order:
            continue
        hoped = {n: gain(study, n) * study.mean(JUDGED_BY, n, answer.duty) for n in answer.order}
        first = hoped[answer.order[0]]
        near = {*answer.best, *answer.unclear}
        names = tuple(n for n in answer.order if n not in near and hoped[n] < first)
        if names:
            found[answer.duty] = names
    return found


def _listed(words: Sequence[str]) -> str:
    """Words with commas, and "and" before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
