"""The Lyapunov exponents of a closed loop."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..stability.lyapunov import LyapunovRun
from .result import Result, table_of, with_unit

BITS = 1.0 / math.log(2.0)  # per nat


@dataclass(frozen=True, repr=False)
class Exponents(Result, LyapunovRun):
    """Lyapunov exponents of a closed loop; see `ballscrew.lyapunov`."""

    @property
    def trusted(self) -> bool:
        """Whether the loop's attractor could be classified."""
        return self.decided

    def pictures(self) -> dict[str, Any]:
        from ..stability.exponent_pictures import convergence_figure

        return {"lyapunov": convergence_figure(self)}

    def headline(self) -> str:
        return f"{self.label}: {self.motion.kind.value} ({self.motion.evidence})"

    def facts(self) -> Iterable[tuple[str, str]]:
        for k, (value, error) in enumerate(zip(self.exponents, self.error, strict=True)):
            yield f"exponent {k + 1}", f"{value * BITS:.6g} +- {error * BITS:.2g} bits/s"
        off = self.sum_rule_error()
        yield "sum rule, relative error", with_unit(off, "")

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
