"""The search for causes: values, noise and causes found in turn until they agree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..records.drive_record import DriveRecord
from .course import Course, Noise, instrument_noise, lay_along, resmoothed
from .drive_model import DriveModel
from .evidence import Prior, fit, volume
from .regression import (
    Added,
    filters,
    fitted_noise,
    law_forces,
    likelihood,
    sensitivities,
    surprises,
)
from .selection import (
    LARGEST,
    Candidate,
    Choice,
    Explanation,
    Problem,
    again,
    amplitudes,
    choose,
    free_spreads,
    pruned,
    refine,
    state_problem,
)
from .threads import in_threads

Vector = npt.NDArray[np.float64]

_FIRST_RMS = 0.05  # of the friction: unmodelled force, before it is fitted
_FIRST_MEMORY = 0.01  # [s]
_ADJUSTMENTS = 3
_TURNS = 4  # of naming causes and adjusting values
_FIRST_CONTENDS = 0.6  # of the best cause's evidence, from which another is tried in earnest
_WORTH = 0.5  # of what a best explanation with rivals scores, from which causes alone are tried
_CONTENDS = 10.0  # odds, in natural logarithms, from which another set of causes is
_MOST_CONTENDERS = 2


@dataclass(frozen=True)
class Situation:
    """Records, the model's adjusted values and the noise, under one explanation."""

    courses: list[Course]
    model: DriveModel
    noise: Noise
    added: Added


def adjusted(
    courses: list[Course],
    model: DriveModel,
    believed: DriveModel,
    noise: Noise,
    added: Added,
    freed: Sequence[str] = (),
    rounds: int = _ADJUSTMENTS,
) -> Situation:
    """The believed values, each within its tolerance (or free), and the noise, fitted."""
    names = model.adjustable
    spread = np.array([believed.tolerance[n] for n in names]) / math.sqrt(3.0)
    free = free_spreads(believed)
    for name in freed:
        spread[names.index(name)] = free[names.index(name)]
    for _ in range(rounds):  # Gauss-Newton
        made = filters(courses, model, noise)
        signal = surprises(courses, model, made, added)
        columns = np.column_stack([signal, sensitivities(courses, model, made, added)])
        mean = np.array([believed.values[n] / model.values[n] - 1.0 for n in names])
        prior = Prior(np.arange(1, len(names) + 1), mean, spread)
        change = fit(columns.T @ columns, [prior]).amplitude
        model = model.changed(
            {
                n: model.values[n] * max(1.0 + float(c), 0.3)
                for n, c in zip(names, change, strict=True)
            }
        )
        courses = [
            resmoothed(c, model, noise, f, u, i)
            for c, f, u, i in zip(courses, added.force, added.command, added.current, strict=True)
        ]
        noise = fitted_noise(courses, model, noise, added)
    return Situation(courses, model, noise, added)


def added_by(members: Iterable[Candidate], amplitude: Vector, courses: Sequence[Course]) -> Added:
    """What members of these amplitudes, shape (c,), add to the records' forces and commands."""
    added = Added.nothing(courses)
    for member in members:
        if not member.shape.freed:
            added = added.more(member.shape, amplitude[member.columns])
    return added


def _unlikelihood(courses: Sequence[Course], situation: Situation) -> float:
    """Minus the logarithm of the records' likelihood along a motion, with the noise it has there.

    The law is steep where a drive sticks, so that motions smoothed under two explanations differ in
    likelihood by far more than the explanations do. Only those along one motion can be compared.
    """
    model, added = situation.model, situation.added
    noise = fitted_noise(courses, model, situation.noise, added)
    return likelihood(courses, model, noise, added, law_forces(courses, model))


@dataclass(frozen=True)
class Found:
    """The end of a search: the situation under the best explanation."""

    situation: Situation
    problem: Problem
    choice: Choice
    first_alone: Mapping[str, float]


def search(records: Sequence[DriveRecord], believed: DriveModel) -> Found:
    """Look for causes; values, noise and causes are found in turn until they agree."""
    courses = [lay_along(r, believed) for r in records]
    channels = [instrument_noise(r)[2] for r in records]
    noise = Noise(np.mean(channels, axis=0), _FIRST_RMS * believed.friction_scale, _FIRST_MEMORY)
    situation = adjusted(courses, believed, believed, noise, Added.nothing(courses))
    first: Mapping[str, float] = {}
    best: Step | None = None
    tried: set[tuple[str, ...]] = set()
    for turn in range(_TURNS):
        found = best.explanation.members if best else ()
        problem = state_problem(
            situation.courses, situation.model, believed, situation.noise, found
        )
        # before anything is known, noise is overrated and the first name alone can be relied on
        choice = choose(problem, largest=1 if turn == 0 else LARGEST)
        first = first or choice.alone
        if not choice.best.members and not best:
            break
        contenders = [e for e in _contenders(choice, turn == 0) if _key(e) not in tried]
        if best and (_key(choice.best) == _key(best.explanation) or not contenders):
            break
        tried |= {_key(e) for e in contenders}
        taken = partial(_step, situation, problem, believed)
        step = min(in_threads(taken, contenders), key=lambda s: s.cost)
        # what was found before may be the better whole, along its own motion
        if best and step.cost > _unlikelihood(situation.courses, situation) + best.price:
            stays = [e for e in choice.others if _key(e) == _key(best.explanation)]
            if stays:
                stays.sort(key=lambda e: -e.score)
                kept = pruned(problem, problem.columns.products(), stays[0])
            else:  # more names than a search tries at once
                kept = again(problem, best.explanation.names)
            choice = replace(choice, best=kept)
            break
        problem, choice = step.problem, replace(choice, best=step.explanation)
        situation, best = step.situation, step
    return Found(situation, problem, choice, first)


def _key(explanation: Explanation) -> tuple[str, ...]:
    return tuple(sorted(explanation.names))


@dataclass(frozen=True)
class Step:
    """What becomes of a situation once an explanation is believed.

    Attributes
    ----------
    cost : float
        Minus the logarithm of how well the records are foretold along the motion of before, noise
        and values adjusted, and the amplitudes averaged over what was as likely before.
    price : float
        Of it, what does not depend on the motion.
    """

    situation: Situation
    problem: Problem
    explanation: Explanation
    cost: float
    price: float


def _step(
    situation: Situation, problem: Problem, believed: DriveModel, explanation: Explanation
) -> Step:
    freed = [m.shape.freed for m in explanation.members if m.shape.freed]
    made = filters(situation.courses, situation.model, situation.noise)
    problem, best = refine(problem, explanation, situation.courses, situation.model, made)
    added = added_by(best.members, amplitudes(problem, best), situation.courses)
    after = adjusted(
        situation.courses,
        situation.model,
        believed,
        situation.noise,
        added,
        freed,
        rounds=2,
    )
    unlikely = sum(
        (after.model.values[n] / believed.values[n] - 1.0) ** 2 / believed.tolerance[n] ** 2
        for n in problem.names
        if n not in freed
    )
    price = 1.5 * unlikely + _freedom(problem, best)
    return Step(after, problem, best, _unlikelihood(situation.courses, after) + price, price)


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

    A cause that changes much looks less than it is around values that do not have it, and so does
    any beside a shapeless rival when the noise is that of the rival: causes that come near with one
    in place of another, and causes alone where the best has rivals. At first, causes go first.
    """
    ranked: dict[tuple[str, ...], Explanation] = {}
    for e in sorted(choice.others, key=lambda e: -e.score):
        if not e.rivals and e.members:
            ranked.setdefault(_key(e), e)
    best = choice.best
    if not ranked:
        return [best]
    nothing = max(e.score for e in choice.others if not e.members)
    own = ranked.get(tuple(sorted(best.causes))) or next(iter(ranked.values()))
    worth = own.score > nothing + _WORTH * (best.score - nothing)
    if best.rivals and not worth:
        return [best]
    least = nothing + _FIRST_CONTENDS * (own.score - nothing) if first else own.score - _CONTENDS
    near = [
        e
        for e in ranked.values()
        if e is not own
        and len(e.names) == len(own.names)
        and len(set(e.names) - set(own.names)) == 1
        and e.score > max(least, nothing)
    ][:_MOST_CONTENDERS]
    if not best.rivals:
        return [best, *near]
    if first and not best.causes:
        return [own, *near]
    return [best, own, *near]
