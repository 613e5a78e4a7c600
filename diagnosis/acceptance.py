"""Which of the chosen causes may be named: what data held out decide.

A cause is named only where it foretells what it has not seen better than the model without it does,
better than any other cause in its place, and better than a free function of the same variables; and
where its size is the same in all parts of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .course import Course
from .diagnosis import NotNamed
from .evidence import fit, side_by_side
from .held_out import Gain, with_values
from .residuals import residual
from .search import added_by
from .selection import (
    MOST_CANCELLED,
    OWN,
    Explanation,
    Problem,
    amplitudes,
    cancelled,
    grown,
    loosened,
    scores,
    without,
)
from .surrogates import chance

Vector = npt.NDArray[np.float64]
Folds = npt.NDArray[np.int64]

LEAST_SHARE = 0.03
"""Of what is left without a cause, that it has to take away: of surprises or of the force."""
LEAST_SHARE_OF_SWINGS = 0.005
"""The same of what swings along the travel: nothing that a law's own error leaves looks like it."""
LEAST_BESIDE = 0.1
"""Of what the largest cause takes away, that any other has to."""
LEAST_P = 0.01
_SWINGS = ("torque_ripple", "position_periodic_friction")
_STEADY = 0.25  # of a gain, that its interval's lower end has to be
_UNCLEAR = 0.05  # of what is named, that structure without a name may be beside it
_NEAR_TOLERANCE = 0.25  # of a tolerance's whole width
_DRAWS = 2000
_LIKE = (0.25, 2.5)  # size in one part of the data, relative to that in all
_AGREE = 0.75  # of the information: parts whose size is like that


@dataclass(frozen=True)
class Accepted:
    """What may be named, and what not.

    Attributes
    ----------
    explanation : Explanation
    chances : dict of str to float
        Of each cause that is named, that as much comes by accident, see `chance`.
    refused : tuple of NotNamed
    freest : Explanation
        What is named, and beside it the free function that has structure left, if one has.
    """

    explanation: Explanation
    chances: dict[str, float]
    refused: tuple[NotNamed, ...]
    freest: Explanation


class Judged(NamedTuple):
    """A member's gain, the chance of as much by accident, and why it may not be named, if so."""

    gain: Gain
    chance: float
    refused: NotNamed | None


def taken_back(
    problem: Problem, before: Accepted, name: str, because: str, folds: Folds
) -> Accepted:
    """What may be named without one of the names after all."""
    now = before.explanation
    now = without(problem, now, now.names.index(name))
    freest, _ = _freest(problem, now, folds)
    return replace(
        before,
        explanation=now,
        refused=(*before.refused, NotNamed(name, because)),
        freest=freest,
    )


def accepted(
    problem: Problem, chosen: Explanation, folds: Folds, courses: Sequence[Course]
) -> Accepted:
    """Take away what does not hold, the weakest first.

    Parameters
    ----------
    folds : ndarray of int, shape (stretches,)
        To which part of the data each stretch belongs.
    """
    refused: list[NotNamed] = []
    now = chosen
    found: dict[str, Judged] = {}
    while now.members:
        found = {
            m.name: _judged(problem, now, k, folds, courses) for k, m in enumerate(now.members)
        }
        failing = {n: j.refused for n, j in found.items() if j.refused is not None}
        if not failing:
            failing = _small_beside(found)
        if not failing and len(now.members) > 1 and _cancel(problem, now):
            failing = {n: NotNamed(n, "it and the other causes cancel each other") for n in found}
        if not failing:
            break
        weakest = min(failing, key=lambda n: found[n].gain.share)
        refused.append(failing[weakest])
        now = without(problem, now, now.names.index(weakest))
    freest, left = _freest(problem, now, folds)
    if now.members and not _clear(problem, now, left, folds):
        free = freest.members[-1].name
        refused += [NotNamed(n, f"too much is left beside it ({free})") for n in now.names]
        for _ in now.names:
            now = without(problem, now, 0)
        freest, left = _freest(problem, now, folds)
    chances = {n: found[n].chance for n in now.names}
    return Accepted(now, chances, tuple(refused), freest)


def _clear(problem: Problem, now: Explanation, left: Gain, folds: Folds) -> bool:
    """Whether the structure beside what is named is small against it."""
    nothing = now
    for _ in now.names:
        nothing = without(problem, nothing, 0)
    mine = held_out_squares(problem, now, folds)
    brought = float((held_out_squares(problem, nothing, folds) - mine).sum())
    return left.share * float(mine.sum()) < _UNCLEAR * brought


def _cancel(problem: Problem, now: Explanation) -> bool:
    """Whether the members bring much more apart than together."""
    return cancelled(problem, problem.columns.products(), now) > MOST_CANCELLED


def _small_beside(found: Mapping[str, Judged]) -> dict[str, NotNamed]:
    """Names that bring so little beside another that it may be what that one's form leaves."""
    # of what is left in the end: share s of the squares without it is s/(1 - s) of those with it
    brings = {n: j.gain.share / max(1.0 - j.gain.share, 1e-9) for n, j in found.items()}
    most = max(brings, key=lambda n: brings[n])
    return {
        n: NotNamed(n, f"it is less than {most} may leave, being not just of that form")
        for n in found
        if brings[n] < LEAST_BESIDE * brings[most]
    }


def held_out_squares(problem: Problem, explanation: Explanation, folds: Folds) -> Vector:
    """What an explanation fitted elsewhere leaves in each stretch, squared, shape (stretches,)."""
    out = np.empty(len(folds))
    columns = np.concatenate([[0], *(p.columns for p in explanation.priors)]).astype(np.int64)
    each = problem.columns.by_stretch(columns)
    priors = side_by_side(explanation.priors)
    for fold in np.unique(folds):
        mine = folds == fold
        fitted = fit(each[~mine].sum(axis=0), priors).amplitude
        weights = np.append(1.0, -fitted)
        out[mine] = np.einsum("i,sij,j->s", weights, each[mine], weights)
    return out


def gain(before: Vector, after: Vector) -> Gain:
    """What goes of the squares in stretches, each shape (stretches,)."""
    random = np.random.default_rng(0)
    count = len(before)
    # neighbours are drawn together: what lasts longer than a stretch is no new evidence
    starts = random.integers(0, count, (_DRAWS, -(-count // 2)))
    drawn = np.concatenate([starts, (starts + 1) % count], axis=1)
    shares = 1.0 - after[drawn].sum(axis=1) / np.maximum(before[drawn].sum(axis=1), 1e-300)
    low, high = np.quantile(shares, [0.025, 0.975])
    whole = 1.0 - float(after.sum()) / max(float(before.sum()), 1e-300)
    return Gain(whole, (float(low), float(high)))


def _judged(
    problem: Problem, now: Explanation, k: int, folds: Folds, courses: Sequence[Course]
) -> Judged:
    """What data held out say of a member, the cheapest question first."""
    name = now.members[k].name
    base = without(problem, now, k)
    mine = held_out_squares(problem, now, folds)
    over = gain(held_out_squares(problem, base, folds), mine)

    def refuse(because: str, like: str = "") -> Judged:
        return Judged(over, 1.0, NotNamed(name, because, like))

    if not over.certain or over.interval[0] < _STEADY * over.share:
        return refuse("what it gains on data held out may be nothing")
    least = LEAST_SHARE_OF_SWINGS if name in _SWINGS else LEAST_SHARE
    if max(over.share, _force_share(problem, now, k, courses)) < least:
        said = f"it gains {100 * over.share:.2g} % on data held out, asked is {100 * least:g} %"
        return refuse(said)
    reason = _size_differs(problem, now, k, folds) or _within_doubt(problem, now, k)
    if reason:
        return refuse(reason)
    for m in base.members:
        if not gain(
            held_out_squares(problem, loosened(problem, base, m.name), folds), mine
        ).certain:
            return refuse(f"{m.name} in another form foretells as much")
    for other, instead in grown(problem, base).items():
        if other == name:
            continue
        others = held_out_squares(problem, instead, folds)
        if instead.members[-1].is_rival:  # it may have the cause in it, and does as well then
            if gain(mine, others).certain:
                return refuse(f"a free function ({other}) foretells more")
        elif not gain(others, mine).certain:
            return refuse(f"{other} foretells as much", like=other)
    p = chance(problem, base, now, courses)
    if p > LEAST_P:
        return refuse(f"as much may come by accident, p = {p:.2g}")
    return Judged(over, p, None)


def _force_share(problem: Problem, now: Explanation, k: int, courses: Sequence[Course]) -> float:
    """Of the mean square of the force left without a member, what it takes away."""

    def left(explanation: Explanation) -> float:
        fitted = amplitudes(problem, explanation)
        added = added_by(explanation.members, fitted, courses)
        return residual(courses, with_values(problem, fitted), added).force_rms ** 2

    return 1.0 - left(now) / max(left(without(problem, now, k)), 1e-300)


def _size_differs(problem: Problem, now: Explanation, k: int, folds: Folds) -> str:
    """Why a member's size cannot be one number; empty if it can."""
    found = scores(problem, now, k)
    estimate = found.estimate()
    member = now.members[k]
    if member.shape.sure is not None and not OWN[0] < float(estimate[0]) < OWN[1]:
        return f"its size is {float(estimate[0]):.2g} of what its shape asks for"
    likes, informations = [], []
    for fold in np.unique(folds):
        mine = folds == fold
        information = float(estimate @ found.pieces[mine].sum(axis=0) @ estimate)
        if information > 0.0:
            size = float(estimate @ found.by_stretch[mine].sum(axis=0)) / information
            likes.append(_LIKE[0] < size < _LIKE[1])
            informations.append(information)
    share = float(np.dot(likes, informations)) / max(sum(informations), 1e-300)
    return "" if share >= _AGREE else "its size differs between parts of the data"


def _within_doubt(problem: Problem, now: Explanation, k: int) -> str:
    """Why a freed value is no error: it is within its tolerance or near; empty if it is one."""
    member = now.members[k]
    if not member.shape.freed:
        return ""
    fitted = amplitudes(problem, now)[member.columns]
    places = member.columns - 1
    near = _NEAR_TOLERANCE * (problem.high - problem.low)[places]
    if np.all((fitted > problem.low[places] - near) & (fitted < problem.high[places] + near)):
        return "the value is hardly beyond its tolerance"
    return ""


def _freest(problem: Problem, now: Explanation, folds: Folds) -> tuple[Explanation, Gain]:
    """What is named with the free function beside it that gains most, if it certainly does."""
    mine = held_out_squares(problem, now, folds)
    best, most = now, gain(mine, mine)
    for e in grown(problem, now).values():
        if e.members[-1].is_rival:
            found = gain(mine, held_out_squares(problem, e, folds))
            if found.certain and found.share > max(most.share, LEAST_SHARE):
                best, most = e, found
    return best, most
