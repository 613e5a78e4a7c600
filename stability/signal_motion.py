"""Long-term motion from signals only, for loops of FMUs without equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .attractor import Attractor, Kind, closings

Vector = npt.NDArray[np.float64]

WINDOW = 0.1  # of the run: its last three windows are compared
SETTLED = 1e-7  # of a signal's range: a smaller swing counts as zero
STILL = 1e-12  # of a signal's range: a smaller change from row to row counts as zero
SMALL = 1e-3  # of a signal's range: largest swing near rest, and distance of a closed cycle
FALLING = 0.5  # largest ratio of the swings of two windows, if the motion comes to rest
LEAST = 1e-6  # of its nominal value: smallest range of a signal
SHRUNK = 0.5  # share of its size that a cycle may lose over the second half of the run
NEUTRAL, DECAYED = 1e-2, 0.1  # nats: most growth of a neutral tangent, least fall of a decaying one


class Signals(Protocol):
    """A coupled run: times [s], the plant's outputs, and how it ended."""

    @property
    def time(self) -> Vector: ...
    @property
    def outputs(self) -> dict[str, Vector]: ...
    @property
    def stopped(self) -> str: ...
    @property
    def diverged(self) -> bool: ...


def signal_motion(
    run: Signals, nominal: Mapping[str, float], growth: Vector | None = None
) -> Attractor:
    """Long-term motion of a coupled run.

    Rest is judged from the last three tenths of the run, cycles from its second half. Only the
    first tangent shows whether an equilibrium is one of a line: it neither grows nor falls at rest
    if a direction is neutral. If the outputs stopped for as long before and moved again, it is not
    at rest: for example a mass that sticks until its force swings back.

    Parameters
    ----------
    run : Signals
    nominal : mapping of str to float
        Nominal values of the outputs.
    growth : ndarray, shape (m,), optional
        Logarithm of the length of the first tangent at the times of the run [nats].
    """
    if run.diverged:
        return Attractor(Kind.DIVERGES, run.stopped, since=float(run.time[-1]))
    if run.stopped:
        return Attractor(Kind.UNDECIDED, run.stopped, "a run that continues beyond this point")
    names, table = list(run.outputs), np.column_stack(list(run.outputs.values()))
    least = LEAST * np.array([nominal[n] for n in names])
    scale = np.maximum(np.ptp(table, axis=0), least)
    end = run.time[-1]
    swings = []
    for k in (3, 2, 1):
        first, behind = np.searchsorted(
            run.time, [(1 - k * WINDOW) * end, (1 - (k - 1) * WINDOW) * end]
        )
        swings.append(np.ptp(table[first : behind + 1], axis=0) / scale)
    before, middle, last = (float(s.max()) for s in swings)
    moves = f"over the last tenth of the run no output moves by more than {last:.2g} of its range"
    falls = middle <= FALLING * before and last <= FALLING * middle and last <= SMALL
    rests = falls or max(middle, last) <= SETTLED
    earlier, present = _stands(run.time, table / scale)
    if rests and earlier >= present > 0.0:
        return Attractor(
            Kind.UNDECIDED,
            f"all outputs have been constant for {present:.4g} s; before this they were constant "
            "for "
            f"{earlier:.4g} s and then moved again",
            "a longer run",
        )
    if rests:
        if falls:
            moves += f", after {middle:.2g} and {before:.2g} in the tenths before"
        return _rest(run, moves, growth)
    widest = int(np.argmax(swings[-1]))
    cycle = _cycle(run, names, table, widest)
    return cycle or Attractor(
        Kind.UNDECIDED,
        "no rest and no periodic returns: over the last tenth of the run "
        f"{names[widest]} moves by {last:.2g} of its range",
        "a longer run, or the equations (--via model)",
    )


def _stands(time: Vector, rows: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Duration of rest of the outputs at the end, and the longest before, without the start [s]."""
    still = np.concatenate([[False], np.abs(np.diff(rows, axis=0)).max(axis=1) <= STILL, [False]])
    ends = np.flatnonzero(np.diff(still.astype(np.int8)))
    begins, ends = ends[::2], ends[1::2]
    lasts = time[ends] - time[begins]
    present = float(lasts[-1]) if len(ends) and ends[-1] == len(time) - 1 else 0.0
    before = lasts[(begins > 0) & (ends < len(time) - 1)]
    return float(before.max(initial=0.0)), present


def _rest(run: Signals, moves: str, growth: Vector | None) -> Attractor:
    if growth is None:
        return Attractor(Kind.REST, moves)
    begin = (1.0 - WINDOW) * run.time[-1]
    grown = float(growth[-1] - np.interp(begin, run.time, growth))
    text = f"{moves}; the first tangent grows by {grown:.2g} nats meanwhile"
    if abs(grown) <= NEUTRAL:
        return Attractor(Kind.LINE, f"{text}: a direction is neutral")
    if grown < -DECAYED:
        return Attractor(Kind.FIXED_POINT, f"{text}: no direction is neutral")
    if grown > 0.0:
        return Attractor(Kind.UNDECIDED, f"{text}: a disturbance may grow", "a longer run")
    return Attractor(Kind.REST, text)


def _cycle(
    run: Signals, names: list[str], table: npt.NDArray[np.float64], widest: int
) -> Attractor | None:
    """A cycle, if outputs of the second half, one period apart, are equal; else None."""
    half = run.time >= 0.5 * run.time[-1]
    time, rows = run.time[half], table[half]
    low, high = rows.min(axis=0), rows.max(axis=0)
    above = rows[:, widest] - 0.5 * (low + high)[widest]
    at = np.flatnonzero((above[:-1] < 0.0) & (above[1:] >= 0.0))
    share = -above[at] / (above[at + 1] - above[at])
    returns = rows[at] + share[:, None] * (rows[at + 1] - rows[at])
    times = time[at] + share * (time[at + 1] - time[at])
    size = np.where(high > low, high - low, np.inf)
    if len(at) < 2:
        return None
    # with few outputs, a return is compared together with its duration and its extremes
    between = np.diff(times)
    whole = np.column_stack(
        [
            returns[1:],
            np.maximum.reduceat(rows, at)[:-1],
            np.minimum.reduceat(rows, at)[:-1],
            between,
        ]
    )
    sizes = np.concatenate([size, size, size, [between.mean()]])
    for lag, error in closings(whole, sizes, SMALL):
        period = float(times[-1] - times[-1 - lag])
        wide = np.ptp(rows[time >= times[-1] - period], axis=0)
        if np.max(np.abs(wide - size) / size, where=np.isfinite(size), initial=0.0) > SHRUNK:
            continue
        swing = 0.5 * float((high - low)[widest])
        return Attractor(
            Kind.CYCLE,
            f"outputs {period:.6g} s apart ({lag} return{'s' if lag > 1 else ''}) differ by "
            f"{error:.2g} of the motion's size, {names[widest]} swings by {swing:.4g} to either "
            "side",
            period=period,
            amplitude=dict(zip(names, (0.5 * (high - low)).tolist(), strict=True)),
            return_error=error,
        )
    return None
