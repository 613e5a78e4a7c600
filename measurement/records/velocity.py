"""Records with the velocity instead of the position, as from motor controllers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

Vector = npt.NDArray[np.float64]

VELOCITY = "v"
INTEGRATED = (
    "x is the integral of v: the start position is not known, and errors of v add up, so that "
    "effects of position cannot be identified"
)
_POSITIONS = {"x", "x_fine"}


def columns_wanted(
    there: Iterable[str], mapping: Mapping[str, str], known: Iterable[str]
) -> list[str]:
    """Our names; without the velocity if the file has a position and no velocity is mapped."""
    measured = _POSITIONS & {*there, *mapping.values()}
    needless = measured and VELOCITY not in mapping.values()
    return [n for n in known if n != VELOCITY or not needless]


def with_position(signals: Mapping[str, Vector], step: float) -> dict[str, Vector]:
    """Signals with the integral of ``v`` as ``x``; without ``v`` if a position was recorded.

    The integral is linear between samples and begins at zero.
    """
    if _POSITIONS & signals.keys():
        return {n: s for n, s in signals.items() if n != VELOCITY}
    x = cumulative_trapezoid(signals[VELOCITY], dx=step, initial=0.0)
    return {**signals, "x": np.asarray(x, dtype=float)}
