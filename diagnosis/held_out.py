"""Residuals on held-out blocks of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .balance import Added
from .blocks import Blocks
from .explained import Explained, built
from .modelled_record import ModelledRecord
from .residuals import AHEAD, Residual, residual
from .scores import Form

Vector = npt.NDArray[np.float64]

_LAPS = range(3, 7)  # numbers of laps of one motion for which repetition is used
_SAME = 1e-3  # largest difference of laps, as a share of the motion's mean square
_SHORTEST_LAP = 1.0  # s
_EIGHTHS = 8  # blocks of a short record, enough for an interval


@dataclass(frozen=True)
class HeldOut:
    """Residuals on held-out data.

    Attributes
    ----------
    parts : str
        What was held out, one at a time.
    squares : Blocks
        Blocks to resample for intervals: seconds, or eighths of short records.
    prior, none, all : Residual
        Residual of the prior model, with fitted values, and with all named causes.
    without, alone : dict of str to Residual
        Residual with all named causes except one, and with one only.
    """

    parts: str
    squares: Blocks
    prior: Residual
    none: Residual
    all: Residual
    without: dict[str, Residual]
    alone: dict[str, Residual]

    def gain(self, before: Residual, after: Residual) -> tuple[float, tuple[float, float]]:
        """Removed share of the mean square in force, and its 95 % interval."""
        found = self.squares.gain(before.force, after.force, before.telling)
        # with too few blocks, the interval is everything from twice the mean square to zero
        return found.value, found.interval or (-1.0, 1.0)


def held_out(found: Explained) -> HeldOut:
    """Fit without each block in turn, and return the residuals on the held-out blocks."""
    study, forms = found.study, found.forms
    names = [m.name for m in found.built]
    none = left_on_blocks(found, [])
    everything = left_on_blocks(found, forms) if forms else none
    if len(forms) == 1:
        without, alone = {names[0]: none}, {names[0]: everything}
    else:
        without = {n: left_on_blocks(found, [f for f in forms if f.name != n]) for n in names}
        alone = {n: left_on_blocks(found, [f for f in forms if f.name == n]) for n in names}
    return HeldOut(
        f"{len(study.bands.parts)} parts",
        Blocks(ends_of_seconds(study.courses, _EIGHTHS)),
        residual(study.courses, study.prior_model, Added.nothing(study.courses)),
        none,
        everything,
        without,
        alone,
    )


def left_on_blocks(found: Explained, forms: Sequence[Form]) -> Residual:
    """Residual of each block with these forms, fitted without the block."""
    study = found.study
    fit = found.catalogue.without(forms)
    lengths = [len(c.x) for c in study.courses]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    total = int(starts[-1])
    force, between, position = np.zeros((3, total))
    whole = Residual(force, between, position, np.zeros(total, dtype=bool))
    for ways, (record, first, last) in zip(fit.ways, study.bands.parts, strict=True):
        one = residual(*built(study, forms, ways[0]))
        width = study.courses[record].width
        begin = first * width
        # a record's last windows end before its last samples
        ends = max(p[2] for p in study.bands.parts if p[0] == record)
        end = last * width if last < ends else lengths[record]
        test = slice(int(starts[record]) + begin, int(starts[record]) + end)
        for name, values in vars(whole).items():
            values[test] = getattr(one, name)[test]
    return whole


def ends_of_seconds(courses: Sequence[ModelledRecord], least: int = 1) -> list[int]:
    """Ends of the seconds over which positions are predicted, among all samples.

    If a record is too short for the `least` number of blocks, its blocks are shorter.
    """
    ends = [0]
    for c in courses:
        start, n = ends[-1], len(c.x)
        every = max(2, min(round(AHEAD / c.step), n // least))
        ends += [start + k for k in (*range(every, n, every), n)]
    return ends


def lap(x: Vector, step: float) -> float:
    """Period of a repeated motion [s]; zero if it does not repeat often enough.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position, `step` seconds apart.
    """
    n = len(x)
    longest = n // _LAPS[0]
    shortest = max(round(_SHORTEST_LAP / step), -(-n // (_LAPS[-1] + 1)))
    if longest <= shortest:
        return 0.0
    moved = x - x.mean()
    spectrum = np.fft.rfft(moved, 2 * n)
    shared = np.fft.irfft(np.abs(spectrum) ** 2)[: longest + 1]  # sum of x(t) x(t + lag)
    squares = np.concatenate([[0.0], np.cumsum(moved**2)])
    lags = np.arange(shortest, longest + 1)
    both = squares[n - lags] + squares[n] - squares[lags]
    apart = np.divide(both - 2.0 * shared[lags], both, out=np.ones(len(lags)), where=both > 0.0)
    best = int(np.argmin(apart))
    return float(lags[best] * step) if apart[best] < _SAME else 0.0


def laps_of(courses: Sequence[ModelledRecord]) -> list[float]:
    """Period of each record's laps [s]; empty if a record has no laps."""
    laps = [lap(c.x, c.step) for c in courses]
    return laps if all(laps) else []
