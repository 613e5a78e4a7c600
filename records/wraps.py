"""Angles and counters that restart after a turn, made continuous."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

_COUNTERS = {2.0**16: "2^16", 2.0**32: "2^32"}
_NEXT_TO = 3.0  # largest step across a wrap, over the largest other step


def unwrapped(name: str, values: Vector, turn: float | None) -> tuple[Vector, list[str]]:
    """Values made continuous at each restart, and a note; unchanged if there is no restart.

    Values restart if all of them are within one turn, and steps of nearly a turn are as small as
    the others after subtracting the turn.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Recorded values; NaN if unknown.
    turn : float or None
        One turn of an angle, in the same unit.
    """
    known = np.isfinite(values)
    steps = np.diff(values[known])
    for period in [*([abs(turn)] if turn else []), *_COUNTERS]:
        far = np.abs(steps) > 0.5 * period
        if not far.any() or far.all() or np.ptp(values[known]) > period * (1 + 1e-9):
            continue
        turns = np.round(steps / period) * far
        on = np.abs(steps - period * turns)
        if on[far].max() > _NEXT_TO * on[~far].max():
            continue
        out = values.copy()
        out[known] -= period * np.concatenate([[0.0], np.cumsum(turns)])
        size = _COUNTERS.get(period, "a turn")
        return out, [
            f"{name} jumps by {size} {int(far.sum())} times: it wraps around and was unwrapped"
        ]
    return values, []
