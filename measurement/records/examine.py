"""Checks of a record before it is used: resolution, bandwidth, clipping, motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .record import Record

_CLIPPED = 0.02  # share of samples at one extreme above which a note is given
_IN_A_ROW = 3  # samples at an extreme that make a flat top
_FALLS = 4.0  # fall of a spectrum within an octave, in powers of ten, that only a filter causes


def check_identifiable(records: Sequence[Record]) -> list[str]:
    """Warnings about several records, or BadRecord if they are not for one diagnosis."""
    if len({"i" in r.signals for r in records}) > 1:
        what = "some records have the current `i` and some do not"
        raise BadRecord(f"{what}; diagnose them separately")
    return [f"{record.name}: {note}" for record in records for note in _examined(record)]


def _examined(record: Record) -> Iterator[str]:
    """Warnings, and changes that were made; BadRecord if it cannot be used for a diagnosis."""
    x, name = record.x, record.name
    if np.ptp(x) == 0:
        why = "without motion nothing is known about friction; record a motion in both directions"
        raise BadRecord(f"{name}: the position never changes ({x[0]:.6g} m): {why}")
    values = record.signals["i" if record.current_alone else "u"]
    if np.ptp(values) == 0 and values[0] == 0:
        what = "the current i" if record.current_alone else "the command u"
        raise BadRecord(f"{name}: {what} is zero all the time")
    yield from record.notes
    highest, half = 2 * carried(record), 0.5 / record.step
    if highest < half:
        said = f"{highest:.3g} Hz, of the {half:.4g} Hz possible with its sampling"
        yield f"the position has no content above {said}: it was filtered"
    for column in (c for c in ("u", "i") if c in record.signals):
        share = np.mean(clipped(record.signals[column]))
        if share > _CLIPPED:
            often = f"{column} is at its largest value in {100 * share:.0f} % of the samples"
            yield f"{often}: clipped? Clipped samples give no information"
    pace = np.diff(np.convolve(x, np.ones(21) / 21, "valid"))
    some = 0.05 * np.abs(pace).max()
    if not (np.any(pace > some) and np.any(pace < -some)):
        what = "effects at reversals, or with the direction, cannot be distinguished"
        yield f"moves in one direction only: {what} from a constant force"


def clipped(values: Vector) -> npt.NDArray[np.bool_]:
    """Samples at the largest or smallest value, several in a row."""
    known = values[np.isfinite(values)]
    span = float(np.ptp(known))
    flat = np.zeros(len(values), dtype=bool)
    for extreme in (known.max(), known.min()) if span else ():
        at = np.abs(values - extreme) <= 1e-9 * span
        edges = np.flatnonzero(np.diff(at, prepend=False, append=False))
        for first, last in edges.reshape(-1, 2):
            flat[first:last] = last - first >= _IN_A_ROW
    return flat


def carried(record: Record) -> float:
    """Frequency above which the spectrum falls as only a filter makes it fall [Hz].

    Without a filter, it is half the sampling rate.
    """
    bent = np.diff(record.x, 2)
    length = min(512, len(bent))  # of parts, whose mean spectrum it is (P. Welch, 1967)
    parts = np.lib.stride_tricks.sliding_window_view(bent, length)[:: length - length // 2]
    parts = (parts - parts.mean(axis=1, keepdims=True)) * np.hanning(length + 1)[:-1]
    power = np.mean(np.abs(np.fft.rfft(parts)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(length, record.step)
    level = np.log10(median_filter(power[1:], 9) + 1e-300)
    for k in range(len(level) // 16, len(level) // 2):
        if level[k] - np.max(level[2 * k :]) > _FALLS:
            return float(frequency[k + 1])
    return float(frequency[-1])
