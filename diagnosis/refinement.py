"""Nonlinear values of chosen causes, found between the points of their grids."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from .causes import CAUSES
from .causes.cause import Shape
from .drive_model import DriveModel
from .evidence import Prior, conditioned, evidence_of, fit, side_by_side
from .explanation import Explanation, bring_of, log_prior_odds_of_form, within_bounds, without
from .modelled_record import ModelledRecord
from .problem import Candidate, Problem
from .regression import Filter, responses, whitened

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_FORMS = 4  # of a cause, that compete once more between the points of their grids
_BEYOND = (0.5, 2.0)  # times the ends of a grid
_SURE = 0.02  # of an amplitude that is one: the size is the value's


def refine(
    problem: Problem,
    explanation: Explanation,
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    made: Sequence[Filter],
    forms: int = _FORMS,
) -> tuple[Problem, Explanation]:
    """The explanation with its causes' nonlinear values found between the points of their grids.

    A cause's forms compete here once more, so many of them: one that is nearly right, at a better
    point, may look better on the grid than the right one.
    """
    for k, m in enumerate(explanation.members):
        if m.is_rival or m.shape.freed:
            continue
        search = _Refinement(problem, explanation, k, courses, model, made)
        found = [search.best(c) for c in _best_of_forms(problem, m, search.others)[:forms]]
        most = max(f.evidence for f in found) - search.nothing
        best = max(found, key=lambda f: f.evidence - log_prior_odds_of_form(f.candidate, most))
        problem, explanation = search.with_member(best)
    return problem, explanation


def _best_of_forms(problem: Problem, member: Candidate, others: Explanation) -> list[Candidate]:
    """Of each form of a member's cause the point of the grid that explains most; its own first."""
    left = conditioned(problem.columns.products(), others.priors)
    best: dict[tuple[object, ...], tuple[float, Candidate]] = {}
    for c in problem.candidates:
        if c.name != member.name or c.is_rival:
            continue
        key = _form(c)
        bring = bring_of(c.shape, *left.of(c.columns))[0] if c is not member else math.inf
        if key not in best or best[key][0] < bring:
            best[key] = bring, c
    ranked = sorted(best.values(), key=lambda b: -b[0])
    return [c for _, c in ranked]


def _form(candidate: Candidate) -> tuple[object, ...]:
    """All of a candidate's values but the one that is found between the grid's points."""
    refined = CAUSES[candidate.name].refined_of(candidate.shape.values)
    rest = tuple(sorted((n, v) for n, v in candidate.shape.values.items() if n != refined))
    return (refined, *rest)


@dataclass(frozen=True)
class _Refined:
    """A candidate at its best value."""

    evidence: float
    candidate: Candidate
    shape: Shape
    columns: Matrix
    mean: Vector
    spread: Vector


@dataclass(frozen=True)
class _Refinement:
    """The search for a member's best value, everything else adjusted within its bounds."""

    problem: Problem
    explanation: Explanation
    place: int
    courses: Sequence[ModelledRecord]
    model: DriveModel
    made: Sequence[Filter]

    @cached_property
    def others(self) -> Explanation:
        """The explanation without the member."""
        return without(self.problem, self.explanation, self.place)

    @cached_property
    def nothing(self) -> float:
        """Evidence without the member."""
        return evidence_of(self.problem.columns.products(), self.others.priors)

    @cached_property
    def used(self) -> npt.NDArray[np.int64]:
        """The signal's column and those of the others."""
        return np.concatenate([[0], *(p.columns for p in self.others.priors)]).astype(np.int64)

    @cached_property
    def base(self) -> Matrix:
        """These columns."""
        return self.problem.columns.of(self.used)

    @cached_property
    def inner(self) -> Matrix:
        """Their products."""
        return self.problem.columns.products()[np.ix_(self.used, self.used)]

    def best(self, start: Candidate) -> _Refined:
        """From a point of the grid to the best between its neighbours."""
        values = start.shape.values
        key = CAUSES[start.name].refined_of(values)
        if key is None:
            return self._at(start, values)
        fixed = dict(values)
        if start.shape.sure is None and start is self.explanation.members[self.place]:
            # how it is linear depends on how large it is
            fitted = fit(self.problem.columns.products(), self.explanation.priors)
            size = fitted.amplitude[np.isin(fitted.columns, start.columns)]
            fixed |= dict(zip(start.shape.amplitudes, size.tolist(), strict=True))
        form = _form(start)
        points = sorted(
            c.shape.values[key]
            for c in self.problem.candidates
            if c.name == start.name and not c.is_rival and _form(c) == form
        )
        here = points.index(values[key])
        grid = CAUSES[start.name].grid(self.courses, self.model)
        ends = [v[key] for v in grid if key in v]
        low = points[here - 1] if here else min(_BEYOND[0] * min(ends), values[key])
        last = here + 1 == len(points)
        high = max(_BEYOND[1] * max(ends), values[key]) if last else points[here + 1]
        found = minimize_scalar(
            lambda q: -self._at(start, {**fixed, key: math.exp(q)}).evidence,
            bounds=(math.log(low), math.log(high)),
            method="bounded",
            options={"xatol": 0.02 * math.log(high / low), "maxiter": 10},
        )
        between = self._at(start, {**fixed, key: math.exp(float(found.x))})
        at_point = self._at(start, fixed)
        # where the evidence has several peaks, the search may have come down on a lower one
        return between if between.evidence > at_point.evidence else at_point

    def _at(self, start: Candidate, values: Mapping[str, float]) -> _Refined:
        shape = CAUSES[start.name].at(self.courses, self.model, values)
        columns = whitened(self.made, responses(self.courses, self.model, shape))
        cross = self.base.T @ columns
        products = np.block([[self.inner, cross], [cross.T, columns.T @ columns]])
        count = columns.shape[1]
        mine = np.arange(len(self.inner), len(products))
        own = side_by_side(self.others.priors)
        _, mean, spread = bring_of(shape, *conditioned(products, own).of(mine))
        if shape.sure is not None:
            spread = np.full(count, _SURE)
        members = self.others.members
        priors = within_bounds(
            self.problem, products, members, [*own[1:], Prior(mine, mean, spread)]
        )
        return _Refined(evidence_of(products, priors), start, shape, columns, mean, spread)

    def with_member(self, found: _Refined) -> tuple[Problem, Explanation]:
        """The problem and the explanation with that candidate in the member's place."""
        candidate = replace(found.candidate, shape=found.shape)
        problem = replace(
            self.problem,
            columns=self.problem.columns.exchanged(int(candidate.columns[0]), found.columns),
            candidates=[candidate if c is found.candidate else c for c in self.problem.candidates],
        )
        members = list(self.explanation.members)
        members[self.place] = candidate
        own = (*self.others.priors[1:], Prior(candidate.columns, found.mean, found.spread))
        priors = within_bounds(problem, problem.columns.products(), members, own)
        return problem, replace(self.explanation, members=tuple(members), priors=priors)
