"""A row of the comparison with the thesis: what it says and prints, and what is computed here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A statement of the thesis as a number that is computed here."""

    where: str  # section, equation, table or figure
    says: str  # what the number is, with its unit
    printed: str | float  # empty: the thesis prints nothing to compare with
    here: Callable[[], float]
    allowed: tuple[float, float] = (-math.inf, math.inf)  # it agrees between these
    why: str = ""  # why it differs

    @property
    def counted(self) -> bool:
        return self.printed != ""

    def agrees(self, here: float) -> bool:
        low, high = self.allowed
        return low <= here <= high

    def told(self, label: str, here: float) -> str:
        verdict = "agrees" if self.agrees(here) else "differs"
        words = f"{label} {self.where}: {self.says}: thesis {self.printed or '-'}"
        return f"{words}, here {here:.7g}: {verdict}"


def near(
    where: str, says: str, printed: float, within: float, here: Callable[[], float], why: str = ""
) -> Row:
    """A row with a printed number, and the largest difference from it."""
    return Row(where, says, printed, here, (printed - within, printed + within), why)
