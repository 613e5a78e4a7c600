"""Which causes explain a study, if any: a search over small sets, weighed by evidence.

All sets of a size are not tried: the best few of each size are kept and grown. A set pays for each
member what naming one of so many costs, so that records without an effect are left without a name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from .evidence import Prior, conditioned, evidence_of, weigh
from .explanation import (
    Explanation,
    apart,
    bring_of,
    log_prior_odds_of_form,
    nothing_in,
    stands,
    within_bounds,
    without,
)
from .problem import BESIDE, KEPT, LOOKED_AT, Candidate, Problem

Matrix = npt.NDArray[np.float64]

LOG_PRIOR_ODDS = 7.0  # of the first name, in natural logarithms of the odds
NEXT_LOG_PRIOR_ODDS = 11.0  # of each further one: two things wrong at once are rarer than one
NONPARAMETRIC_LOG_PRIOR_ODDS = 5.0  # what has a shape for everything has to be better by so much
LARGEST = 7  # members of a set: real machines have several things wrong at once


@dataclass(frozen=True)
class Choice:
    """The best explanation, and those it cannot be told from.

    Attributes
    ----------
    best : Explanation
    others : list of Explanation
        All that were looked at, best first.
    alone : mapping of str to float
        Evidence of each name by itself over nothing.
    """

    best: Explanation
    others: list[Explanation]
    alone: Mapping[str, float] = field(default_factory=dict)


def choose(problem: Problem, largest: int = LARGEST) -> Choice:
    """The set of causes that explains the records best.

    Of causes only; what each shapeless rival explains by itself is told beside it.
    """
    products = problem.columns.products()
    empty = nothing_in(problem)
    causes = [c for c in problem.candidates if not c.is_rival]
    named = _search(problem, products, empty, causes, largest)
    free = _search(problem, products, empty, [c for c in problem.candidates if c.is_rival], 1)
    chosen = pruned(problem, products, named[0])
    alone = {}
    for only in (named, free):
        for e in only:
            if len(e.members) == 1:
                alone[e.names[0]] = e.gains[0]
    others = sorted([*named, *free], key=lambda e: -e.score)
    return Choice(chosen, others, alone)


def strongest_alone(problem: Problem) -> float:
    """Evidence that the strongest cause brings by itself, in natural logarithms."""
    left = conditioned(problem.columns.products(), nothing_in(problem).priors)
    causes = [c for c in problem.candidates if not c.is_rival]
    return max((bring_of(c.shape, *left.of(c.columns))[0] for c in causes), default=0.0)


def grown(problem: Problem, start: Explanation) -> dict[str, Explanation]:
    """The explanation with one more name, for each name there is, in a form that stands."""
    products = problem.columns.products()
    more = _grow(problem, products, start, problem.candidates)
    return {n: e for n, e in more.items() if stands(problem, products, e)}


def beside(problem: Problem, start: Explanation, member: Candidate) -> Explanation:
    """The explanation with one more candidate, or as it is where that is in it already."""
    found = _grow(problem, problem.columns.products(), start, [member])
    return found.get(member.name, start)


def loosened(problem: Problem, explanation: Explanation, name: str) -> Explanation:
    """The explanation with all forms of a cause beside it, together, of any amplitudes.

    What a cause has in a form that is only nearly right, it has here. Forms that have their size
    in them are left out: with other amplitudes they are another cause.
    """
    forms = [
        c.columns
        for c in problem.candidates
        if c.name == name and not c.shape.freed and c.shape.sure is None
    ]
    columns = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *forms]))
    taken = np.concatenate([p.columns for p in explanation.priors[1:]] or [columns[:0]])
    columns = np.setdiff1d(columns, taken)
    if not len(columns):
        return explanation
    products = problem.columns.products()
    spread = weigh(*conditioned(products, explanation.priors).of(columns)).spread
    own = (*explanation.priors[1:], Prior(columns, np.zeros(len(columns)), spread))
    return replace(explanation, priors=within_bounds(problem, products, explanation.members, own))


def with_one_value(problem: Problem, explanation: Explanation) -> Explanation | None:
    """The explanation with one value wrong where it has several, if it has.

    Which values are wrong can be told once they are adjusted only: they act together.
    """
    several = [k for k, m in enumerate(explanation.members) if len(m.shape.freed) > 1]
    if not several:
        return None
    name = explanation.members[several[0]].name
    ones = [c for c in problem.candidates if c.name == name and len(c.shape.freed) == 1]
    rest = without(problem, explanation, several[0])
    return _grow(problem, problem.columns.products(), rest, ones).get(name)


def again(problem: Problem, names: Sequence[str]) -> Explanation:
    """The explanation by these names, however many."""
    products = problem.columns.products()
    explanation = nothing_in(problem)
    for name in names:
        mine = [c for c in problem.candidates if c.name == name]
        explanation = _grow(problem, products, explanation, mine).get(name, explanation)
    return _ordered(problem, products, explanation)


def _search(
    problem: Problem,
    products: Matrix,
    start: Explanation,
    candidates: Sequence[Candidate],
    largest: int,
) -> list[Explanation]:
    """Explanations grown from one by up to `largest` more names, best first."""
    beam, seen = [start], [start]
    for size in range(largest):
        grown: dict[frozenset[str], Explanation] = {}
        for e in beam:
            for name, more in _grow(problem, products, e, candidates).items():
                key = frozenset((*e.names, name))
                if key not in grown or grown[key].score < more.score:
                    grown[key] = more
        ranked = sorted(grown.values(), key=lambda e: -e.score)
        ranked = [e for e in ranked[:LOOKED_AT] if stands(problem, products, e)]
        beam = ranked[:KEPT]
        seen += ranked if size == 0 else ranked[: 4 * KEPT]
        if not beam or beam[0].score < max(e.score for e in seen) - NEXT_LOG_PRIOR_ODDS:
            break
    return sorted(seen, key=lambda e: -e.score)


def pruned(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """An explanation, in order, without the members that later ones made needless."""
    best = _ordered(problem, products, best)
    while len(best.members) > 1:
        needless = [k for k, g in enumerate(best.gains) if g < NEXT_LOG_PRIOR_ODDS]
        if not needless:
            break
        best = _ordered(problem, products, without(problem, best, needless[-1]))
    return best


def _ordered(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """The members in the order of what the evidence would lose without each."""
    whole = evidence_of(products, best.priors)
    loses = [
        whole - evidence_of(products, without(problem, best, k).priors)
        for k in range(len(best.members))
    ]
    order = sorted(range(len(loses)), key=lambda k: -loses[k])
    return replace(
        best,
        members=tuple(best.members[k] for k in order),
        gains=tuple(float(loses[k]) for k in order),
    )


def _grow(
    problem: Problem, products: Matrix, start: Explanation, candidates: Sequence[Candidate]
) -> dict[str, Explanation]:
    """The explanation with one more name, for each name."""
    left = conditioned(products, start.priors)
    found: dict[str, list[tuple[float, Candidate, tuple[Prior, ...]]]] = {}
    for c in candidates:
        if c.name in start.names:
            continue
        if c.shape.freed:
            if any(np.isin(c.columns, m.columns).any() for m in start.members if m.shape.freed):
                continue
            freed = within_bounds(problem, products, (*start.members, c), start.priors[1:])
            bring = evidence_of(products, freed) - left.evidence
            found.setdefault(c.name, []).append((bring, c, freed))
            continue
        bring, mean, spread = bring_of(c.shape, *left.of(c.columns))
        priors = (*start.priors, Prior(c.columns, mean, spread))
        found.setdefault(c.name, []).append((bring, c, priors))
    out = {}
    for name, options in found.items():
        # of forms that explain alike, the simplest
        most = max(o[0] for o in options)
        options.sort(key=lambda o: log_prior_odds_of_form(o[1], most) - o[0])
        best = next((o for o in options if apart(problem, products, start, o[1], o[2])), options[0])
        # one of many shapes was to be picked as well
        brings = float(np.logaddexp.reduce([o[0] for o in options])) - math.log(len(options))
        log_prior_odds = (
            max(NEXT_LOG_PRIOR_ODDS, BESIDE * max(start.gains)) if start.members else LOG_PRIOR_ODDS
        )
        if best[1].is_rival:
            log_prior_odds += NONPARAMETRIC_LOG_PRIOR_ODDS
        members = (*start.members, best[1])
        out[name] = Explanation(
            members,
            within_bounds(problem, products, members, best[2][1:]),
            start.score + brings - log_prior_odds,
            (*start.gains, brings),
        )
    return out
