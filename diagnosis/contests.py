"""Contests of a cause on data held out: with other causes in its place, and with free functions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .causes import CAUSES
from .evidence import fit, side_by_side
from .explanation import Explanation
from .held_out import Gain
from .problem import Candidate, Problem
from .selection import beside, grown, loosened

Vector = npt.NDArray[np.float64]
Folds = npt.NDArray[np.int64]

_APART = 0.7  # of what a cause brings, that it brings beside another if they are two things
_LESS = 0.005  # of what a cause brings, that another in its place has to bring less
_SUFFICES = 0.25  # of that, if what the other adds beside the cause is less than this
_FREER = 0.1  # of what a cause brings, that a free function may bring more: forms are not exact
_STRUCTURE = 0.03  # of what is left, that a free function has to take away to be one
_DRAWS = 2000


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


def rivalled(
    problem: Problem,
    base: Explanation,
    member: Candidate,
    before: Vector,
    mine: Vector,
    folds: Folds,
    least_lead: float,
) -> tuple[str, str, Explanation | None]:
    """Why something else predicts as much: the reason, its name, and whether it is to be taken.

    One explanation encompasses another if that one adds nothing beside it.

    Parameters
    ----------
    before, mine : ndarray, shape (stretches,)
        Squares that are left in each stretch without the member and with it.
    least_lead : float
        Of what is left with another cause in its place, that it has to take away.
    """
    brought = float((before - mine).sum())

    def together(instead: Explanation) -> Vector:
        return held_out_squares(problem, beside(problem, instead, member), folds)

    in_its_place = grown(problem, base)
    for other, instead in in_its_place.items():
        if other == member.name:
            continue
        others = held_out_squares(problem, instead, folds)
        if instead.members[-1].is_rival:  # it may have the cause in it, and does as well then
            more = float((mine - others).sum())
            if gain(mine, others).certain and more > _FREER * brought:
                return f"a free function ({other}) predicts more", "", None
            continue
        lead = gain(others, mine)
        worse = lead.certain and lead.share >= least_lead
        less = float((others - mine).sum())
        if worse and less >= _LESS * brought:
            continue
        both = together(instead)
        if worse and float((mine - both).sum()) < _SUFFICES * less:
            continue
        if float((others - both).sum()) < _APART * brought:  # else they are two things
            return f"{other} predicts as much", other, instead if less < 0.0 else None
    for other in CAUSES:
        if other in (*base.names, member.name):
            continue
        instead = loosened(problem, base, other)
        others = held_out_squares(problem, instead, folds)
        more = float((mine - others).sum())
        if more <= _FREER * brought or not gain(mine, others).certain:
            continue
        if float((others - together(instead)).sum()) < _APART * brought:
            said = f"{other}, in several forms at once, predicts more"
            return said, other, in_its_place.get(other)
    return "", "", None


def freest_beside(problem: Problem, now: Explanation, folds: Folds) -> tuple[Explanation, Gain]:
    """What is named with the free function beside it that gains most, if it certainly does."""
    mine = held_out_squares(problem, now, folds)
    best, most = now, gain(mine, mine)
    for e in grown(problem, now).values():
        if e.members[-1].is_rival:
            found = gain(mine, held_out_squares(problem, e, folds))
            if found.certain and found.share > max(most.share, _STRUCTURE):
                best, most = e, found
    return best, most
