"""How much later than the motion a force is recorded, by the records alone.

Filters, buses and loggers delay one signal more than another. A fit believes what is known of that
beforehand, a part of a sampling interval where nothing is said, since a delay and the damping of
bristles look much alike. Here the delay is free, all else is fitted anew, and the error comes from
pieces of the records. A delay that is not what was known is for the records to be corrected by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from ..records.record import Record
from .fit_errors import outer_products_of_pieces
from .intervals import CONFIDENCE, Interval
from .layout import StackedRecords
from .optimizer import Climb

_FREE = 0.1  # spread of a delay of which nothing is known [s]
_KNOWN = 2.0  # spreads of what is known beforehand, within which a delay is no news
_METHOD = "maximum likelihood, the delay free, errors from pieces of the records"


def time_shifts(climb: Climb) -> tuple[Interval, ...]:
    """How much later the force comes than the motion [s], for each rate of the records.

    Parameters
    ----------
    climb : Climb
        At the most likely parameters.
    """
    problem = climb.problem
    p, q = problem.size, problem.size + problem.course.clocks
    walk = Climb(problem, climb.point.coordinates, climb.held, climb.hidden)
    walk.centre, walk.errors = climb.centre, climb.errors
    walk.prior_std = climb.prior_std.copy()
    walk.prior_std[p:q] = _FREE
    walk.point = climb.point.moved(np.zeros(len(climb.prior_std)))
    walk.run(15)
    pieces = walk.normal(walk.point)
    inverse = np.asarray(np.linalg.inv(pieces.information), dtype=float)
    meat, share = outer_products_of_pieces(walk, pieces, inverse, q)
    robust = np.diag(inverse @ meat @ inverse)[p:q]
    errors = np.sqrt(np.maximum(robust, np.diag(inverse)[p:q]))
    found = []
    for value, error, column in zip(walk.point.delays, errors, share.T[p:q], strict=True):
        freedom = max(column.sum() ** 2 / max(float(np.sum(column**2)), 1e-300), 2.0)
        reach = float(student.ppf(0.5 + CONFIDENCE / 2, freedom)) * float(error)
        low, high = float(value) - reach, float(value) + reach
        told = reach < _FREE / 2
        found.append(Interval(float(value), "s", float(error), low, high, _METHOD, told))
    return tuple(found)


def corrected(
    records: Sequence[Record], course: StackedRecords, shifts: Sequence[Interval]
) -> list[Record] | None:
    """The records with their forces moved by the shifts; None where no shift is news.

    Parameters
    ----------
    records : sequence of Record
    course : StackedRecords
        Of the records.
    shifts : sequence of Interval
        Of `time_shifts`.
    """
    moved = list(records)
    for k, record in enumerate(records):
        shift = shifts[int(course.clock[k])]
        if shift.low is None or shift.high is None or shift.standard_error is None:
            continue
        known = _KNOWN * record.delay_std
        if not shift.identified or (shift.low <= known and shift.high >= -known):
            continue
        later = record.lags.get("force", 0.0) + shift.value
        doubt = math.hypot(record.delay_std, shift.standard_error)
        lags = {**record.lags, "force": later}
        moved[k] = replace(record, lags=lags, delay_std=doubt)
    return moved if any(a is not b for a, b in zip(moved, records, strict=True)) else None
