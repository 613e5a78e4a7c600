"""The delay of a recorded force relative to the motion, by the fit of the law.

Filters, buses and loggers delay one signal more than another. A fit gives the delay to within a
sample or two, so a larger one is taken out step by step, with a new fit after each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from ..records.record import Record
from .fit import fit_along
from .intervals import Fit, Interval
from .layout import StackedRecords, lay_out
from .left_over import LeftOver, left_over


@dataclass(frozen=True)
class FittedRecords:
    """Records laid end to end, a law fitted to them, and what it leaves."""

    records: list[Record]
    course: StackedRecords
    fit: Fit
    left: LeftOver

    @property
    def explained(self) -> bool:
        """Whether the law leaves not much more than noise."""
        return self.left.force <= 2.0 * self.left.noise

    @property
    def late(self) -> Interval:
        """Delay of the force after the motion; of several rates, the largest [s]."""
        put = [r.lags.get("force", 0.0) for r in self.records]
        late = zip((self.fit.late[int(c)] for c in self.course.clock), put, strict=True)
        return max((i.plus(p) for i, p in late), key=lambda i: abs(i.value))


def fit_late_records(
    records: Sequence[Record],
    law: str,
    fixed: Mapping[str, float],
    beside: Collection[str],
    progress: Callable[[str], None],
) -> FittedRecords:
    """Fit a law to records, and correct them by the delay of the force if it is certain.

    It is not if some lags are known, if it may be within what was known of it before, or if the law
    does not explain the force: such a law takes its own error for a delay.
    """

    def fitted(records: list[Record], guess: Mapping[str, float] | None) -> FittedRecords:
        course = lay_out(records)
        fit = fit_along(records, law, course, None, guess, fixed, beside, progress)
        return FittedRecords(records, course, fit, left_over(course, fit))

    def beyond(late: Interval) -> bool:
        """Whether all of the interval is beyond twice what was known of the delay."""
        reach = math.inf if late.high is None else late.high - late.value
        return abs(late.value) > 2.0 * known + reach

    known = max(r.delay_std for r in records)
    first = last = fitted(list(records), None)
    for _ in range(8 * (not any(r.lags for r in records))):  # each by a sample or more
        if not any(map(beyond, last.fit.late)):
            break
        moved = []
        for record, clock in zip(last.records, last.course.clock, strict=True):
            step = last.fit.late[clock]
            total = record.lags.get("force", 0.0) + step.value
            spread = math.hypot(known, step.standard_error or 0.0)
            moved.append(replace(record, lags={"force": total}, delay_std=spread))
        before, last = last, fitted(moved, last.fit.values)
        if last.left.force > before.left.force:
            break
    return last if beyond(last.late) and last.explained else first
