"""The delay of a recorded force relative to the motion, by the fit of the law.

Filters, buses and loggers delay one signal more than another. A fit gives the delay to within a
sample or two, so a larger one is taken out step by step, with a new fit after each.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..records.record import Record
from .fit import fit_along
from .fit_result import Fit
from .friction_estimation import FrictionEstimate, estimate_friction
from .intervals import Interval
from .layout import StackedRecords, lay_out
from .left_over import LeftOver, left_over

MISFIT = 2.0  # residual over force noise above which the law is not trusted
_KNOWN = 2.0  # a delay within this many prior standard deviations is not corrected
_MOST = 8  # corrections, each by a sample or more


@dataclass(frozen=True)
class FittedRecords:
    """Records with their motion, a law fitted to them, and what it leaves."""

    records: list[Record]
    estimates: list[FrictionEstimate]
    course: StackedRecords
    fit: Fit
    left: LeftOver

    @property
    def explained(self) -> bool:
        """Whether the law leaves not much more than noise."""
        return self.left.force <= MISFIT * self.left.noise

    @property
    def late(self) -> Interval:
        """Delay of the force after the motion; of several rates, the largest [s]."""
        put = [r.lags.get("force", 0.0) for r in self.records]
        late = zip((self.fit.late[int(c)] for c in self.course.clock), put, strict=True)
        return max((i.plus(p) for i, p in late), key=lambda i: abs(i.value))


def fit_records(
    records: Sequence[Record],
    law: str,
    fixed: Mapping[str, float],
    beside: Collection[str],
    guess: Mapping[str, float] | None = None,
) -> FittedRecords:
    """Fit a law to records as they are, see `fit_along`."""
    estimates = [estimate_friction(r) for r in records]
    course = lay_out(records, estimates)
    fit = fit_along(records, law, course, guess=guess, fixed=fixed, beside=beside)
    noise = float(np.median([e.force_noise for e in estimates]))
    return FittedRecords(list(records), estimates, course, fit, left_over(course, fit, noise))


def _beyond(late: Interval, known: float) -> bool:
    """Whether all of the interval is beyond what was known of the delay [s]."""
    reach = math.inf if late.high is None else late.high - late.value
    return abs(late.value) > _KNOWN * known + reach


def fit_late_records(
    records: Sequence[Record], law: str, fixed: Mapping[str, float], beside: Collection[str]
) -> FittedRecords:
    """Fit a law to records, and correct them by the delay of the force if it is certain.

    It is not if some lags are known, if it may be within what was known of it before, or if the law
    does not explain the force: such a law takes its own error for a delay.
    """
    first = last = fit_records(records, law, fixed, beside)
    known = max(r.delay_std for r in records)
    for _ in range(_MOST * (not any(r.lags for r in records))):
        if not any(_beyond(i, known) for i in last.fit.late):
            break
        moved = []
        for record, clock in zip(last.records, last.course.clock, strict=True):
            step = last.fit.late[clock]
            total = record.lags.get("force", 0.0) + step.value
            spread = math.hypot(known, step.standard_error or 0.0)
            moved.append(replace(record, lags={"force": total}, delay_std=spread))
        before, last = last, fit_records(moved, law, fixed, beside, last.fit.values)
        if last.left.force > before.left.force:
            break
    return last if _beyond(last.late, known) and last.explained else first
