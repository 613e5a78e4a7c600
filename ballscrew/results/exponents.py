"""The Lyapunov exponents of a closed loop."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.page import Figure, plotly_figure
from ..orchestration.shown_units import quantity
from ..stability.lyapunov import LyapunovRun
from .reported import Reported, Table, figures_table, values_of
from .result import table_of

BITS = 1.0 / math.log(2.0)  # per nat
_LISTS = ("exponents", "exponents_error", "asymptotic", "asymptotic_error")


@dataclass(frozen=True, repr=False)
class Exponents(Reported, LyapunovRun):
    """Lyapunov exponents of a closed loop; see `ballscrew.lyapunov`."""

    kind, function = "Exponents", "ballscrew.lyapunov"

    @property
    def trusted(self) -> bool:
        """Whether the loop's attractor could be classified."""
        return self.decided

    def pictures(self) -> dict[str, Any]:
        from ..stability.exponent_pictures import convergence_figure

        return {"lyapunov": convergence_figure(self)}

    def headline(self) -> str:
        return f"{self.label}: {self.motion.kind.value} ({self.motion.evidence})"

    def verdict_and_reason(self) -> tuple[str, str]:
        return f"{self.label}: {self.motion.kind.value}", self.motion.evidence

    def doubts(self) -> Iterable[str]:
        if not self.decided:
            yield f"Undecided; what would decide: {self.motion.would_decide}"
        reached = float(self.spectrum.time[-1])
        if self.loop and reached < self.loop.stop and self.motion.since is None:
            yield f"The exponents are those until t = {reached:g} s, not {self.loop.stop:g} s."
        if self.tighter is None:
            yield "The error of the exponents is not known."

    def page_pictures(self) -> list[Figure]:
        from ..stability.exponent_pictures import pictures_of_exponents

        return [plotly_figure(p) for p in pictures_of_exponents(self)]

    def tables(self) -> list[Table]:
        from ..stability.exponent_pictures import moved_by

        figures = self.figures()
        values, errors, limits, limit_errors = (figures.pop(f"{n}_bits_per_s") for n in _LISTS)
        columns = (
            "exponent",
            "bits/s",
            f"+- (95 %, from {moved_by(self)})",
            "limit",
            "+- (95 %)",
        )
        rows = [
            (
                f"{k + 1}",
                f"{value:.6g}",
                "not known" if math.isnan(errors[k]) else f"{errors[k]:.3g}",
                *(f"{x[k]:.6g}" if x and k < len(x) else "-" for x in (limits, limit_errors)),
            )
            for k, value in enumerate(values)
        ]
        others = figures_table("lyapunov.json", figures, {})
        return [Table("Exponents", columns, rows), others]

    def values_used(self) -> list[Table]:
        return [] if self.loop is None else values_of(self.loop, self.loop.step is not None)

    def facts(self) -> Iterable[tuple[str, str]]:
        for k, (value, error) in enumerate(zip(self.exponents, self.error, strict=True)):
            yield f"exponent {k + 1}", f"{value * BITS:.6g} +- {error * BITS:.2g} bits/s"
        off = self.sum_rule_error()
        yield "sum rule, relative error", quantity(off, "")

    def to_pandas(self) -> Any:
        """A row for each exponent: finite-time value, its error and the limit [bits/s]."""
        limit = self.motion.limit
        return table_of(
            {
                "exponent": self.exponents * BITS,
                "error": self.error * BITS,
                "limit": [math.nan] * len(self.exponents) if limit is None else limit * BITS,
            }
        )
