"""How likely a cause is found by accident: the whole search, on surrogates of the record.

What is left of a record is cut into stretches, and these are put back in another order, among
stretches of like motion. So a surrogate has the record's own noise where no cause is: no model of
the noise is asked, and what lasts longer or hangs on the motion is in the surrogates, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .course import Course
from .evidence import conditioned, gains, left_of, weighed_gains
from .regression import ends_of_stretches
from .selection import Candidate, Explanation, Problem, amplitudes

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

SURROGATES = 199
_LIKE = 6  # stretches of like motion, that change places


def chance(
    problem: Problem, base: Explanation, now: Explanation, courses: Sequence[Course]
) -> float:
    """Share of surrogates in which some cause brings as much as the best does in the record.

    Parameters
    ----------
    base, now : Explanation
        Without the cause that is asked about, and with it: what this one leaves is the noise.
    courses : sequence of Course

    Returns
    -------
    float
        At least one over the number of surrogates and one.
    """
    columns = np.concatenate(problem.columns.blocks, axis=1)
    fitted = amplitudes(problem, now)
    fitted[0] = -1.0
    drawn = _reordered(-columns @ fitted, problem.columns.edges, _paces(courses))
    products = problem.columns.products()
    own = conditioned(products, base.priors)
    signals = np.column_stack(
        [
            own.of(np.arange(problem.columns.count))[1],
            left_of(products, base.priors, columns.T @ drawn),
        ]
    )
    causes: dict[str, list[Vector]] = {}
    for c in problem.candidates:
        if not c.is_rival and c.name not in base.names:
            inner = own.of(c.columns)[0]
            causes.setdefault(c.name, []).append(_brings(problem, c, inner, signals[c.columns]))
    # one of many shapes was to be picked as well
    best = np.max(
        [np.logaddexp.reduce(b, axis=0) - math.log(len(b)) for b in causes.values()], axis=0
    )
    return float(np.mean(np.append(best[1:], best[0]) >= best[0]))


def _brings(problem: Problem, candidate: Candidate, inner: Matrix, signals: Matrix) -> Vector:
    """Evidence that a candidate brings to each signal, shape (signals,)."""
    count = len(candidate.columns)
    if candidate.shape.freed:
        return gains(inner, signals, np.zeros(count), problem.free[candidate.columns - 1])
    if candidate.shape.sure is not None:
        return gains(inner, signals, np.ones(count), np.full(count, candidate.shape.sure))
    return weighed_gains(inner, signals)


def _paces(courses: Sequence[Course]) -> Vector:
    """Root mean square of the speed in each stretch [m/s]."""
    squares = np.concatenate([c.v for c in courses]) ** 2
    return np.sqrt([squares[a:b].mean() for a, b in pairwise(ends_of_stretches(courses))])


def _reordered(left: Vector, edges: Sequence[int], paces: Vector) -> Matrix:
    """Surrogates of what is left, shape (n, SURROGATES)."""
    random = np.random.default_rng(0)
    length = int(np.diff(edges).min())
    starts = np.array(edges[:-1])
    by_pace = np.argsort(paces)
    out = np.repeat(left[:, None], SURROGATES, axis=1)
    for k in range(SURROGATES):
        for first in range(0, len(starts), _LIKE):
            group = by_pace[first : first + _LIKE]
            for goal, source in zip(group, random.permutation(group), strict=True):
                a, b = starts[goal], starts[source]
                out[a : a + length, k] = left[b : b + length]
    return out
