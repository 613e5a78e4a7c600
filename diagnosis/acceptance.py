"""Which of the chosen causes may be named: what data held out decide.

A cause is named only where it predicts what it has not seen better than the model without it does,
better than any other cause in its place, and better than a free function of the same variables; and
where its size is the same in all parts of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .causes import CAUSES
from .contests import freest_beside, gain, held_out_squares, rivalled
from .diagnosis import NotNamed
from .explanation import (
    MOST_CANCELLED,
    Explanation,
    amplitudes,
    cancelled,
    evidence_brought,
    restricted_to,
    without,
)
from .held_out import Gain, with_values
from .modelled_record import ModelledRecord
from .plausibility import (
    at_an_end,
    drives,
    follows_within_a_sample,
    not_shown,
    size_differs,
    within_tolerance,
)
from .problem import Problem
from .residuals import residual, rms
from .search import added_by
from .selection import loosened

Vector = npt.NDArray[np.float64]
Folds = npt.NDArray[np.int64]

LEAST_SHARE = 0.08
"""Of the innovations that are left without a cause, that it has to take away."""
LEAST_SHARE_OF_SWINGS = 0.05
"""The same of what swings along the travel: nothing that a law's own error leaves looks like it."""
LEAST_SHARE_OF_VALUES = 0.1
"""The same of each value that may be anything: what is slightly wrong in a law looks like them."""
LEAST_SHARE_OF_FORCE = 0.4
"""Of the mean square of the force, instead: what is slow shows there."""
_SLOW = 0.3  # of the share of innovations, that is asked for then
LEAST_EVIDENCE = 300.0
"""In natural logarithms: faultless records bring up to a hundred, wrong names more."""
LEAST_SIZE = 0.005
"""Of the friction, that the force of anything but a swing has to be: laws are not more exact."""
LEAST_LEAD = 0.1
"""Of what another cause leaves in its place, that it has to take away, where the drive follows its
command within a sampling interval: what happens between samples is not known there."""
LEAST_BESIDE = 0.1
"""Of what the largest cause takes away, that any other has to; all where one may be the other."""
_FITS_ALL = {"parameter_error", "compliance"}  # beside any other
SWINGS = ("torque_ripple", "position_periodic_friction")
_PLACES = 4  # stretches that a gain comes from, as many as alike would be, or as are clear
_CLEAR, _CLEAR_SHARE = 9.0, 0.1  # squares in the noise's variance, share of a stretch's
_LOSES = 0.1  # of what is gained, that may be lost elsewhere
_ALONE = 0.25  # of what a cause brings beside others, that it has to bring alone
_UNCLEAR = 0.1  # of what is named, that structure without a name may be beside it


@dataclass(frozen=True)
class Accepted:
    """What may be named, and what not.

    Attributes
    ----------
    explanation : Explanation
    refused : tuple of NotNamed
    freest : Explanation
        What is named, and beside it the free function that has structure left, if one has.
    """

    explanation: Explanation
    refused: tuple[NotNamed, ...]
    freest: Explanation


class Judged(NamedTuple):
    """A member's gain, and why it may not be named, if so.

    Another cause may do better in its place.
    """

    gain: Gain
    refused: NotNamed | None
    better: Explanation | None = None


def taken_back(
    problem: Problem, before: Accepted, name: str, because: str, folds: Folds
) -> Accepted:
    """What may be named without one of the names after all."""
    now = before.explanation
    now = without(problem, now, now.names.index(name))
    freest, _ = freest_beside(problem, now, folds)
    return replace(
        before,
        explanation=now,
        refused=(*before.refused, NotNamed(name, because)),
        freest=freest,
    )


def accepted(
    problem: Problem, chosen: Explanation, folds: Folds, courses: Sequence[ModelledRecord]
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
    replaced: set[str] = set()
    while now.members:
        found = {
            m.name: _judged(problem, now, k, folds, courses) for k, m in enumerate(now.members)
        }
        failing = {n: j.refused for n, j in found.items() if j.refused is not None}
        if not failing and len(now.members) > 1:
            failing = (
                _small_beside(found) or _nothing_alone(problem, now, folds) or _cancel(problem, now)
            )
        if not failing:
            break
        weakest = min(failing, key=lambda n: found[n].gain.share)
        better = found[weakest].better
        if better and better.names[-1] not in replaced:
            replaced.add(weakest)
            now = better
            continue
        refused.append(failing[weakest])
        now = without(problem, now, now.names.index(weakest))
    freest, left = freest_beside(problem, now, folds)
    if now.members and not _clear(problem, now, left, folds):
        free = freest.members[-1].name
        refused += [NotNamed(n, f"too much is left beside it ({free})") for n in now.names]
        now = restricted_to(problem, now, ())
        freest, left = freest_beside(problem, now, folds)
    return Accepted(now, tuple(refused), freest)


def _clear(problem: Problem, now: Explanation, left: Gain, folds: Folds) -> bool:
    """Whether the structure beside what is named is small against it."""
    mine = held_out_squares(problem, now, folds)
    nothing = held_out_squares(problem, restricted_to(problem, now, ()), folds)
    brought = float((nothing - mine).sum())
    return left.share * float(mine.sum()) < _UNCLEAR * brought


def _cancel(problem: Problem, now: Explanation) -> dict[str, NotNamed]:
    """All names, if they bring much more apart than together."""
    if cancelled(problem, problem.columns.products(), now) <= MOST_CANCELLED:
        return {}
    return {n: NotNamed(n, "it and the other causes cancel each other") for n in now.names}


def _nothing_alone(problem: Problem, now: Explanation, folds: Folds) -> dict[str, NotNamed]:
    """Names that bring little without the others: what the others make up for is none."""
    nothing = held_out_squares(problem, restricted_to(problem, now, ()), folds).sum()
    mine = held_out_squares(problem, now, folds).sum()
    out = {}
    for k, name in enumerate(now.names):
        beside_others = held_out_squares(problem, without(problem, now, k), folds).sum() - mine
        only = held_out_squares(problem, restricted_to(problem, now, (name,)), folds).sum()
        if nothing - only < _ALONE * beside_others:
            out[name] = NotNamed(name, "it brings little without the other causes")
    return out


def _small_beside(found: Mapping[str, Judged]) -> dict[str, NotNamed]:
    """Names that bring so little beside another that it may be what that one's form leaves."""
    # of what is left in the end: share s of the squares without it is s/(1 - s) of those with it
    brings = {n: j.gain.share / max(1.0 - j.gain.share, 1e-9) for n, j in found.items()}
    most = max(brings, key=lambda n: brings[n])

    def least(name: str) -> float:
        alike = name in CAUSES[most].mistaken_for or most in CAUSES[name].mistaken_for
        return 1.0 if alike or _FITS_ALL & {name, most} else LEAST_BESIDE

    return {
        n: NotNamed(n, f"it is less than {most} may leave, being not just of that form")
        for n in found
        if brings[n] < least(n) * brings[most]
    }


def _judged(
    problem: Problem, now: Explanation, k: int, folds: Folds, courses: Sequence[ModelledRecord]
) -> Judged:
    """What data held out say of a member, the cheapest question first."""
    member = now.members[k]
    name = member.name
    base = without(problem, now, k)
    mine = held_out_squares(problem, now, folds)
    before = held_out_squares(problem, base, folds)
    over = gain(before, mine)

    def refuse(because: str, like: str = "", better: Explanation | None = None) -> Judged:
        return Judged(over, NotNamed(name, because, like), better=better)

    # what is left may be more than the noise that the windows were weighed with
    noise = max(float(mine.sum()) / np.count_nonzero(problem.columns.blocks[0]), 1.0)
    if not over.certain or not _steady(over, before, mine, noise):
        return refuse("what it gains on data held out may be nothing")
    least = LEAST_SHARE_OF_SWINGS if name in SWINGS else LEAST_SHARE
    if member.shape.freed:
        least = LEAST_SHARE_OF_VALUES * len(member.shape.freed)
    without_it, with_it = (_forces(problem, e, courses) for e in (base, now))
    of_force = 1.0 - (rms(with_it) / max(rms(without_it), 1e-300)) ** 2
    slow = of_force > LEAST_SHARE_OF_FORCE and over.share > _SLOW * least
    if over.share < least and not slow:
        said = f"it gains {100 * over.share:.2g} % on data held out, asked is {100 * least:g} %"
        return refuse(said)
    evidence = evidence_brought(problem, base, now)
    if evidence < LEAST_EVIDENCE:
        return refuse(f"its evidence is {evidence:.2g}, asked is {LEAST_EVIDENCE:g}")
    size = rms(with_it - without_it)
    if not member.shape.freed:  # values that are fitted otherwise beside it are not its own
        own = added_by([member], amplitudes(problem, now), courses)
        command = problem.model.per_command * rms(np.concatenate(own.command))
        size = min(size, rms(np.concatenate(own.force)) + command)
    size /= problem.model.friction_scale
    if name not in SWINGS and size < LEAST_SIZE:
        return refuse(f"its force is {100 * size:.2g} % of the friction: no law is as exact")
    reason = (
        at_an_end(now, k, courses)
        or drives(problem, now, k, courses)
        or size_differs(problem, now, k, folds)
        or not_shown(problem, now, k, courses)
        or within_tolerance(problem, now, k, courses)
    )
    if reason:
        return refuse(reason)
    for m in base.members:
        if not gain(
            held_out_squares(problem, loosened(problem, base, m.name), folds), mine
        ).certain:
            return refuse(f"{m.name} in another form predicts as much")
    lead = LEAST_LEAD if follows_within_a_sample(problem.model, courses) else 0.0
    reason, like, better = rivalled(problem, base, member, before, mine, folds, lead)
    if reason:
        return refuse(reason, like, better)
    return Judged(over, None)


def _steady(over: Gain, before: Vector, after: Vector, noise: float) -> bool:
    """Whether a gain comes from several places, and is as sure all over the record or lost nowhere.

    Parameters
    ----------
    before, after : ndarray, shape (stretches,)
        Squares that are left in each stretch without the cause and with it.
    noise : float
        Variance of the innovations.
    """
    gains = before - after
    won = np.maximum(gains, 0.0)
    alike = won.sum() ** 2 / max(float(won @ won), 1e-300)
    clear = np.count_nonzero((gains > _CLEAR * noise) & (gains > _CLEAR_SHARE * before))
    kept = won.sum() - gains.sum() < _LOSES * won.sum()
    return bool(max(alike, clear) >= _PLACES and (over.sure or kept))


def _forces(
    problem: Problem, explanation: Explanation, courses: Sequence[ModelledRecord]
) -> Vector:
    """Force that an explanation leaves where samples tell anything [N]."""
    fitted = amplitudes(problem, explanation)
    added = added_by(explanation.members, fitted, courses)
    found = residual(courses, with_values(problem, fitted), added)
    return found.force[found.telling]
