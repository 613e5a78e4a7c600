"""Angles and counters that restart after a turn, made continuous."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

_COUNTERS = {2.0**bits: f"2^{bits}" for bits in range(12, 33)}
_NEXT_TO = 3.0  # largest step across a wrap, over the largest other step


def unwrapped(name: str, values: Vector, turn: float | None) -> tuple[Vector, list[str]]:
    """Values made continuous at each restart, and a note; unchanged if there is no restart.

    Values restart if all of them are within one turn, or the size of a counter, and steps of nearly
    a turn are as small as the others after subtracting it. `turn` is one turn in their unit.
    """
    known = np.isfinite(values)
    steps = np.diff(values[known])
    extent = float(np.ptp(values[known])) if known.any() else 0.0
    for period in [*([abs(turn)] if turn else []), *_COUNTERS]:
        if not 0.5 * period < extent <= period * (1 + 1e-9):
            continue
        far = np.abs(steps) > 0.5 * period
        if not far.any() or far.all():
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
