"""The search for causes: values, noise and causes found in turn until they agree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..records.drive_record import DriveRecord
from .balance import Added, calibrated, recalibrated
from .drive_model import DriveModel
from .evidence import Prior, fit_within, volume
from .explanation import Explanation, amplitudes, nothing_in, stands
from .modelled_record import (
    ModelledRecord,
    driven_by_current,
    lay_along,
    with_law_force,
    with_own_offsets,
)
from .problem import (
    Candidate,
    Problem,
    bounds,
    driven_by,
    free_spreads,
    prior_changes,
    state_problem,
)
from .refinement import refine
from .regression import (
    Noise,
    filters,
    fitted_noise,
    leftovers,
    likelihood,
    sensitivities,
    whitened,
)
from .residuals import at_samples, check_motion
from .selection import LOG_PRIOR_ODDS, Choice, again, choose, pruned, with_one_value

Vector = npt.NDArray[np.float64]

_ADJUSTMENTS = 6
_SETTLED = 0.05  # of its spread, that nothing changes by any more
_TURNS = 3  # of naming causes and adjusting values
_FIRST_CONTENDS = 0.6  # of the best cause's evidence, from which another is tried in earnest
_CONTENDS = 10.0  # odds, in natural logarithms, from which another set of causes is
_MOST_CONTENDERS = 2


@dataclass(frozen=True)
class Situation:
    """Records, the model's adjusted values and the noise, under one explanation."""

    courses: list[ModelledRecord]
    model: DriveModel
    noise: Noise
    added: Added


def adjusted(
    courses: list[ModelledRecord],
    model: DriveModel,
    prior_model: DriveModel,
    added: Added,
    freed: Sequence[str] = (),
    rounds: int = _ADJUSTMENTS,
    coloured: bool = True,
) -> Situation:
    """The prior values, each within its tolerance (or free), and the noise, fitted.

    Values leave the least that noise does not predict of itself, or, unless it is `coloured`, the
    least force.
    """
    names = model.adjustable
    priors = calibrated(courses)
    spread = np.array([prior_model.tolerance[n] for n in names]) / math.sqrt(3.0)
    free = free_spreads(prior_model)
    for name in freed:
        spread[names.index(name)] = free[names.index(name)]
    spread = np.append(spread, [d.spread for d in priors.values()])
    for _ in range(rounds):  # Gauss-Newton
        left = leftovers(courses, model, added)
        noise = fitted_noise(courses, model, left)
        made = filters(courses, noise if coloured else driven_by(noise))
        parts = [
            np.concatenate([y[:, :, None], s], axis=2)
            for y, s in zip(left, sensitivities(courses, model, added), strict=True)
        ]
        columns = whitened(made, parts)
        mean = prior_changes(prior_model, model, courses)
        prior = Prior(np.arange(1, len(spread) + 1), mean, spread)
        low, high = bounds(prior_model, model, freed, courses)
        change = fit_within(columns.T @ columns, [prior], low, high)
        model = model.changed(
            {n: model.values[n] * (1.0 + float(c)) for n, c in zip(names, change, strict=False)}
        )
        moved = dict(zip(priors, change[len(names) :].tolist(), strict=True))
        courses = [with_law_force(c, model) for c in recalibrated(courses, moved)]
        if np.all(np.abs(change) < _SETTLED * spread):
            break
    left = leftovers(courses, model, added)
    courses = [
        replace(c, unknown=at_samples(c, y[:, 0])) for c, y in zip(courses, left, strict=True)
    ]
    return Situation(courses, model, fitted_noise(courses, model, left), added)


def added_by(
    members: Iterable[Candidate], amplitude: Vector, courses: Sequence[ModelledRecord]
) -> Added:
    """What members of these amplitudes, shape (c,), add to the records' forces and commands."""
    added = Added.nothing(courses)
    for member in members:
        if not member.shape.freed:
            added = added.more(member.shape, amplitude[member.columns])
    return added


def _unlikelihood(situation: Situation, noise: Noise) -> float:
    """Minus the logarithm of the records' likelihood.

    What is compared has one noise, that of the situation that leaves least: under a noise of its
    own, a situation that lacks a cause has the effect for noise.
    """
    return likelihood(situation.courses, situation.model, noise, situation.added)


def _first_situation(courses: list[ModelledRecord], prior_model: DriveModel) -> Situation:
    """Values adjusted, forces by voltage or by current, whichever leaves less."""
    nothing = Added.nothing(courses)
    situation = adjusted(courses, prior_model, prior_model, nothing)
    if not all(c.has_current for c in courses):
        return situation
    courses = [driven_by_current(c, prior_model) for c in situation.courses]
    other = adjusted(courses, situation.model, prior_model, nothing)
    return min(situation, other, key=lambda s: float(s.noise.sizes[0]))


@dataclass(frozen=True)
class Found:
    """The end of a search: the situation under the best explanation.

    Attributes
    ----------
    first_alone : mapping of str to float
        Evidence of each cause or free function by itself, before anything was found.
    single : Step or None
        What became of the situation under the first cause alone.
    """

    situation: Situation
    problem: Problem
    choice: Choice
    first_alone: Mapping[str, float]
    single: Step | None = None


def search(records: Sequence[DriveRecord], prior_model: DriveModel) -> Found:
    """Look for causes; values, noise and causes are found in turn until they agree."""
    courses = with_own_offsets([lay_along(r, prior_model) for r in records], prior_model)
    check_motion(courses)
    situation = _first_situation(courses, prior_model)
    first: Mapping[str, float] = {}
    best: Step | None = None
    single: Step | None = None
    tried: set[tuple[str, ...]] = set()
    for turn in range(_TURNS):
        found = best.explanation.members if best else None
        problem = state_problem(
            situation.courses, situation.model, prior_model, situation.noise, found
        )
        choice = choose(problem)
        first = first or choice.alone
        if not choice.best.members and not best:
            return _nothing_found(situation, prior_model, choice, first)
        contenders = [e for e in _contenders(choice, turn == 0) if _key(e) not in tried]
        one = with_one_value(problem, choice.best) if turn == 0 else None
        contenders += [one] if one else []
        if best and _key(choice.best) == _key(best.explanation):
            break
        if best and not contenders:
            choice = _kept(problem, choice, best.explanation)
            break
        tried |= {_key(e) for e in contenders}
        steps = [_step(situation, problem, prior_model, e) for e in contenders]
        steps = [s for s in steps if s.stands]
        if not best:
            single = _best_single(steps)
            if single:
                name = single.explanation.names[0]
                steps = [s for s in steps if name in s.explanation.names]
        if not steps:
            if best:
                choice = _kept(problem, choice, best.explanation)
                break
            return _nothing_found(situation, prior_model, choice, first)
        noise = min((s.situation.noise for s in steps), key=lambda n: float(n.sizes[0]))
        costs = [_unlikelihood(s.situation, noise) + s.log_prior_odds for s in steps]
        step, cost = steps[int(np.argmin(costs))], min(costs)
        before = _unlikelihood(situation, noise)
        if not best and cost + LOG_PRIOR_ODDS > before + _strain(situation, prior_model):
            return _nothing_found(situation, prior_model, choice, first)
        # what was found before may be the better whole, along its own motion
        if best and cost > before + best.log_prior_odds:
            choice = _kept(problem, choice, best.explanation)
            break
        problem, choice = step.problem, replace(choice, best=step.explanation)
        situation, best = step.situation, step
    else:
        return Found(situation, problem, choice, first, single)
    problem, last = _in_their_forms(situation, problem, choice.best)
    return Found(situation, problem, replace(choice, best=last), first, single)


def _in_their_forms(
    situation: Situation, problem: Problem, explanation: Explanation
) -> tuple[Problem, Explanation]:
    """The explanation refined; which form each cause has is decided already."""
    made = filters(situation.courses, problem.noise)
    return refine(problem, explanation, situation.courses, situation.model, made, forms=1)


def only_first(found: Found, prior_model: DriveModel) -> Found | None:
    """The end of a search under the first cause alone, where it has found others beside it."""
    single = found.single
    if single is None or _key(single.explanation) == _key(found.choice.best):
        return None
    after, members = single.situation, single.explanation.members
    problem = state_problem(after.courses, after.model, prior_model, after.noise, members)
    best = again(problem, single.explanation.names)
    problem, best = _in_their_forms(after, problem, best)
    return Found(after, problem, replace(found.choice, best=best), found.first_alone)


def taking(found: Found, prior_model: DriveModel, names: Sequence[str]) -> Found | None:
    """The end of a search as if these causes had been found; None if one has no form here."""
    situation, problem = found.situation, found.problem
    if not any(c.name in names for c in problem.candidates):
        problem = state_problem(situation.courses, situation.model, prior_model, situation.noise)
    explanation = again(problem, names)
    if set(explanation.names) != set(names):
        return None
    step = _step(situation, problem, prior_model, explanation)
    after, members = step.situation, step.explanation.members
    problem = state_problem(after.courses, after.model, prior_model, after.noise, members)
    problem, best = _in_their_forms(after, problem, again(problem, names))
    return Found(after, problem, replace(found.choice, best=best), found.first_alone)


def _kept(problem: Problem, choice: Choice, explanation: Explanation) -> Choice:
    """The choice of the names that an explanation had before, in the forms that are now best."""
    stays = [e for e in choice.others if _key(e) == _key(explanation)]
    if stays:
        best = max(stays, key=lambda e: e.score)
        return replace(choice, best=pruned(problem, problem.columns.products(), best))
    # more names than a search tries at once
    return replace(choice, best=again(problem, explanation.names))


def _nothing_found(
    situation: Situation, prior_model: DriveModel, choice: Choice, first: Mapping[str, float]
) -> Found:
    """The end of a search without a cause: what is left is noise, and is weighed as such."""
    problem = state_problem(
        situation.courses, situation.model, prior_model, situation.noise, found=()
    )
    return Found(situation, problem, replace(choice, best=nothing_in(problem)), first)


def _key(explanation: Explanation) -> tuple[str, ...]:
    return tuple(sorted(explanation.names))


@dataclass(frozen=True)
class Step:
    """What becomes of a situation once an explanation is accepted.

    Attributes
    ----------
    log_prior_odds : float
        In natural logarithms: for values that are not the prior ones, and for amplitudes that were
        as likely to be others.
    """

    situation: Situation
    problem: Problem
    explanation: Explanation
    log_prior_odds: float

    @property
    def stands(self) -> bool:
        """Whether its values are such as a drive can have, see `stands`."""
        return stands(self.problem, self.problem.columns.products(), self.explanation)


def _step(
    situation: Situation, problem: Problem, prior_model: DriveModel, explanation: Explanation
) -> Step:
    freed = [n for m in explanation.members for n in m.shape.freed]
    made = filters(situation.courses, problem.noise)
    problem, best = refine(problem, explanation, situation.courses, situation.model, made)
    added = added_by(best.members, amplitudes(problem, best), situation.courses)
    after = adjusted(
        situation.courses,
        situation.model,
        prior_model,
        added,
        freed,
        rounds=2,
    )
    log_prior_odds = _strain(after, prior_model, freed) + _freedom(problem, best)
    return Step(after, problem, best, log_prior_odds)


def _strain(situation: Situation, prior_model: DriveModel, freed: Sequence[str] = ()) -> float:
    """What it costs that values are not the prior ones."""
    return 1.5 * sum(
        (situation.model.values[n] / prior_model.values[n] - 1.0) ** 2
        / prior_model.tolerance[n] ** 2
        for n in prior_model.adjustable
        if n not in freed
    )


def _freedom(problem: Problem, explanation: Explanation) -> float:
    """What it costs that an explanation's amplitudes could have been others."""
    products = problem.columns.products()
    fitted = amplitudes(problem, explanation)
    cost = volume(products, explanation.priors) - volume(products, [problem.prior])
    for prior in explanation.priors[1:]:
        if not np.any(prior.mean):
            cost += 0.5 * float(np.sum((fitted[prior.columns] / prior.spread) ** 2))
    return cost


def _contenders(choice: Choice, first: bool) -> list[Explanation]:
    """The best explanation and those that are worth a comparison in earnest with it.

    A cause that changes much looks less than it is around values that do not have it: causes that
    come near with one in place of another are tried, too.
    """
    ranked: dict[tuple[str, ...], Explanation] = {}
    for e in sorted(choice.others, key=lambda e: -e.score):
        if not e.nonparametric_alternatives and e.members:
            ranked.setdefault(_key(e), e)
    best = choice.best
    if not ranked:
        return [best]
    nothing = max(e.score for e in choice.others if not e.members)
    own = ranked.get(tuple(sorted(best.causes))) or next(iter(ranked.values()))
    leading = max((e.score for e in ranked.values() if len(e.names) == 1), default=own.score)
    least = nothing + _FIRST_CONTENDS * (leading - nothing) if first else own.score - _CONTENDS
    size = 1 if first else len(own.names)
    near = [
        e
        for e in ranked.values()
        if e is not own
        and len(e.names) == size
        and (first or len(set(e.names) - set(own.names)) == 1)
        and e.score > max(least, nothing)
    ]
    return [best, *near[: _MOST_CONTENDERS + (len(best.members) > 1)]]


def _best_single(steps: Sequence[Step]) -> Step | None:
    """The single cause that does best, once values are adjusted to it.

    Around values that no cause is known of, a cause that changes much looks less than it is, and
    sets that lack it look better than they are: others are sought beside the first, not without it.
    """
    alone = [s for s in steps if len(s.explanation.members) == 1]
    if not alone:
        return None
    noise = min((s.situation.noise for s in steps), key=lambda n: float(n.sizes[0]))
    return min(alone, key=lambda s: _unlikelihood(s.situation, noise) + s.log_prior_odds)
