"""A set of causes with the spreads under which it is weighed, and what it can and cannot be."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .causes.cause import Shape
from .evidence import Prior, conditioned, evidence_of, fit, fit_within, gain, side_by_side, weigh
from .problem import Candidate, Problem, free_range

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MOST_CANCELLED = 1.5  # squares of what members bring, over that of what they bring together
_HELD = 1e-3  # of its spread, to one that stands at the end of its prior
OWN = (0.6, 1.6)  # amplitude of a cause whose shape has its size in it
_PER_AMPLITUDE = 3.0  # evidence that one amplitude more in a form has to bring
_INEXACT = 1e-3  # the same as a share of all that the form brings: no form is just right
_ROUGHLY = (0.3, 3.0)  # the same at a point of a grid, next to the size


@dataclass(frozen=True)
class Explanation:
    """A set of candidates with the spreads under which it was weighed.

    Attributes
    ----------
    members : tuple of Candidate
        In order of gain.
    priors : tuple of Prior
        Of the adjustable values first, then of each member that has columns of its own.
    score : float
        Evidence less the price of the names.
    gains : tuple of float
        Evidence that each member brought when it was taken in.
    """

    members: tuple[Candidate, ...]
    priors: tuple[Prior, ...]
    score: float
    gains: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members)

    @property
    def causes(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members if not m.is_rival)

    @property
    def nonparametric_alternatives(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members if m.is_rival)


def nothing_in(problem: Problem) -> Explanation:
    """The explanation without a name."""
    products = problem.columns.products()
    priors = within_bounds(problem, products, (), ())
    return Explanation((), priors, evidence_of(products, priors), ())


def within_bounds(
    problem: Problem, products: Matrix, members: Sequence[Candidate], own: Sequence[Prior]
) -> tuple[Prior, ...]:
    """Priors of values and members, in which values that would leave their bounds are held there.

    Parameters
    ----------
    own : sequence of Prior
        Of the members that have columns of their own.
    """
    freed = [int(c) - 1 for m in members if m.shape.freed for c in m.columns]
    mean, spread = problem.prior.mean.copy(), problem.prior.spread.copy()
    spread[freed] = problem.free[freed]
    low, high = problem.low.copy(), problem.high.copy()
    low[freed], high[freed] = -np.inf, np.inf
    found = fit_within(products, [Prior(problem.prior.columns, mean, spread), *own], low, high)
    held = (found <= low) | (found >= high)
    mean[held] = found[held]
    spread[held] *= _HELD
    return (Prior(problem.prior.columns, mean, spread), *own)


def stands(problem: Problem, products: Matrix, explanation: Explanation) -> bool:
    """Whether values that may be anything are still such as a drive can have.

    A mass or a resistance below zero is none. And a large change that others cancel can fit
    anything, far beyond where a value acts linearly.
    """
    for k, m in enumerate(explanation.members):
        if (
            m.shape.sure is not None
            and not _ROUGHLY[0] < own_size(problem, products, explanation, k) < _ROUGHLY[1]
        ):
            return False
    if not can_be(problem, explanation):
        return False
    freed = any(m.shape.freed for m in explanation.members)
    if not freed and len(explanation.members) < 2:
        return True
    return cancelled(problem, products, explanation) < MOST_CANCELLED


def can_be(problem: Problem, explanation: Explanation) -> bool:
    """Whether values that may be anything are within the range of what can be wrong."""
    fitted = amplitudes(problem, explanation)
    for m in explanation.members:
        if not m.shape.freed:
            continue
        for n, c in zip(m.shape.freed, m.columns, strict=True):
            size = (1.0 + fitted[c]) * problem.model.values[n] / problem.prior_model.values[n]
            low, high = free_range(n)
            if not low < size < high:
                return False
    return True


def _beside(explanation: Explanation, member: int) -> list[Prior]:
    """Priors of all but a member's own, values held or not as they are with it."""
    gone = explanation.members[member].columns
    return [p for p in explanation.priors if not np.array_equal(p.columns, gone)]


def own_size(problem: Problem, products: Matrix, explanation: Explanation, member: int) -> float:
    """Amplitude of a cause whose shape has its size in it, as the data alone have it."""
    column = explanation.members[member].columns[:1]
    inner, signal = conditioned(products, _beside(explanation, member)).of(column)
    return float(signal[0] / max(inner[0, 0], 1e-300))


def evidence_brought(problem: Problem, before: Explanation, after: Explanation) -> float:
    """By how much one explanation is more likely than another, in natural logarithms."""
    products = problem.columns.products()
    return evidence_of(products, after.priors) - evidence_of(products, before.priors)


def cancelled(problem: Problem, products: Matrix, explanation: Explanation) -> float:
    """Squares of what the members bring, over the square of what they bring together."""
    freed = [int(c) - 1 for m in explanation.members if m.shape.freed for c in m.columns]
    spread = problem.prior.spread.copy()
    spread[freed] = 1e-9 * spread[freed]  # what is a member's is not the values'
    values = Prior(problem.prior.columns, problem.prior.mean, spread)
    columns = np.concatenate([m.columns for m in explanation.members])
    left, _ = conditioned(products, [values]).of(columns)
    fitted = fit(products, explanation.priors)
    amplitude = dict(zip(fitted.columns.tolist(), fitted.amplitude, strict=True))
    alone, whole, at = 0.0, np.zeros(len(columns)), 0
    for m in explanation.members:
        mean = problem.prior.mean[m.columns - 1] if m.shape.freed else 0.0
        mine = np.array([amplitude[int(c)] for c in m.columns]) - mean
        for own in np.diag(mine) if m.shape.freed else mine[None, :]:  # values may cancel, too
            part = np.zeros(len(columns))
            part[at : at + len(mine)] = own
            alone += float(part @ left @ part)
            whole += part
        at += len(mine)
    return alone / max(float(whole @ left @ whole), 1e-300)


def apart(
    problem: Problem,
    products: Matrix,
    start: Explanation,
    member: Candidate,
    priors: tuple[Prior, ...],
) -> bool:
    """Whether values that may be anything together do not only cancel each other."""
    if len(member.shape.freed) < 2:
        return True
    alone = Explanation((member,), priors, start.score, (0.0,))
    return cancelled(problem, products, alone) < MOST_CANCELLED


def log_prior_odds_of_form(candidate: Candidate, most: float) -> float:
    """What a form of a cause has to bring more than a simpler one, the best bringing `most`."""
    each = max(_PER_AMPLITUDE, _INEXACT * most)
    return 0.0 if candidate.is_rival else each * len(candidate.columns)


def bring_of(shape: Shape, inner: Matrix, signal: Vector) -> tuple[float, Vector, Vector]:
    """Evidence that a shape brings, with the mean and the spread of its amplitudes."""
    if shape.sure is not None:
        mean, spread = np.ones(len(signal)), np.full(len(signal), shape.sure)
        return gain(inner, signal, mean, spread), mean, spread
    weighed = weigh(inner, signal)
    return weighed.gain, np.zeros(len(signal)), weighed.spread


def amplitudes(problem: Problem, explanation: Explanation, used: Mask | None = None) -> Vector:
    """Most likely amplitudes of all columns, zero where an explanation has none, shape (c,).

    From all stretches or those used, shape (stretches,).
    """
    columns = np.concatenate([[0], *(p.columns for p in explanation.priors)]).astype(np.int64)
    if used is None:
        products = problem.columns.products()[np.ix_(columns, columns)]
    else:
        products = problem.columns.by_stretch(columns)[used].sum(axis=0)
    out = np.zeros(problem.columns.count)
    out[columns[1:]] = fit(products, side_by_side(explanation.priors)).amplitude
    return out


@dataclass(frozen=True)
class Scores:
    """What each stretch says of a member's amplitudes, the other members given.

    Attributes
    ----------
    by_stretch : ndarray, shape (stretches, m)
    information : ndarray, shape (m, m)
    pieces : ndarray, shape (stretches, m, m)
        Of it, what each stretch brings.
    """

    by_stretch: Matrix
    information: Matrix
    pieces: npt.NDArray[np.float64]

    def estimate(self) -> Vector:
        """Amplitudes by least squares, without a prior."""
        total = self.by_stretch.sum(axis=0)
        return np.asarray(np.linalg.lstsq(self.information, total, rcond=None)[0])

    def widening(self) -> float:
        """By how much standard errors are larger than white noise would make them.

        From the scatter of what the stretches say once the member itself is in the model.
        """
        left = self.by_stretch - np.einsum("sij,j->si", self.pieces, self.estimate())
        found = float(np.trace(np.linalg.lstsq(self.information, left.T @ left, rcond=None)[0]))
        return math.sqrt(max(found / self.information.shape[0], 1.0))


def scores(problem: Problem, explanation: Explanation, member: int) -> Scores:
    """The scores of a member at the fit without it."""
    columns = explanation.members[member].columns
    if explanation.members[member].shape.sure is None:
        priors: Sequence[Prior] = without(problem, explanation, member).priors
    else:  # without a shape of its size, values would go to their bounds and stay there
        priors = _beside(explanation, member)
    products = problem.columns.products()
    fitted = fit(products, priors)
    mine = np.isin(fitted.columns, columns)  # a freed value stays at its prior
    amplitude = fitted.amplitude.copy()
    amplitude[mine] = 0.0
    mean = np.concatenate([p.mean for p in priors])
    amplitude[mine] = mean[mine]
    rest = fitted.columns[~mine]
    precision = np.diag(np.concatenate([p.spread for p in priors])[~mine] ** -2.0)
    cross = products[np.ix_(rest, columns)]
    share = np.linalg.solve(products[np.ix_(rest, rest)] + precision, cross)
    weights = np.zeros((problem.columns.count, len(columns)))
    weights[columns, np.arange(len(columns))] = 1.0
    weights[rest] -= share
    left = np.zeros(problem.columns.count)
    left[0] = 1.0
    left[fitted.columns] -= amplitude
    used = np.unique(np.concatenate([[0], fitted.columns, columns]))
    inner = problem.columns.by_stretch(used)
    by_stretch = np.einsum("im,sij,j->sm", weights[used], inner, left[used])
    information = products[np.ix_(columns, columns)] - cross.T @ share
    pieces = np.einsum("im,sij,jk->smk", weights[used], inner, weights[used])
    return Scores(by_stretch, information, pieces)


def restricted_to(
    problem: Problem, explanation: Explanation, names: Collection[str]
) -> Explanation:
    """The explanation with the members of these names only."""
    for k in reversed(range(len(explanation.members))):
        if explanation.members[k].name not in names:
            explanation = without(problem, explanation, k)
    return explanation


def without(
    problem: Problem, explanation: Explanation, member: int, products: Matrix | None = None
) -> Explanation:
    """The explanation without one of its members."""
    products = problem.columns.products() if products is None else products
    members = tuple(c for k, c in enumerate(explanation.members) if k != member)
    gains = tuple(g for k, g in enumerate(explanation.gains) if k != member)
    gone = explanation.members[member].columns
    own = [p for p in explanation.priors[1:] if not np.array_equal(p.columns, gone)]
    priors = within_bounds(problem, products, members, own)
    return Explanation(members, priors, explanation.score, gains)
