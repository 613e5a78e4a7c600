"""Checks of a record before it is used: resolution, bandwidth, clipping, motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from scipy.signal import welch

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .record import Record, held_samples

_CLIPPED = 0.02  # share of samples at one extreme above which a note is given
_IN_A_ROW = 3  # samples at an extreme that make a flat top
_SEGMENT = 1024  # samples of a segment
_LEAKS = 8  # unused spectral lines on each side of a strong one
_BANDS = 12  # bands per octave
_NOTHING = 1e-4  # power above a frequency, over that below it, that counts as zero
_HIGHEST = 0.8  # highest cut-off of a filter that is reported, over half the sampling rate
_STRAIGHT = 1e-3  # second difference that counts as zero, over the largest one
_REGULAR = 0.98  # least share of bends at regular distances


def check_identifiable(records: Sequence[Record]) -> list[str]:
    """Warnings about several records, or BadRecord if they are not for one diagnosis."""
    if len({"i" in r.signals for r in records}) > 1:
        raise BadRecord(
            "some records have the current `i` and some do not; diagnose them separately"
        )
    return [f"{record.name}: {note}" for record in records for note in _examined(record)]


def _examined(record: Record) -> Iterator[str]:
    """Warnings, and changes that were made; BadRecord if it cannot be used for a diagnosis."""
    x, name = record.x, record.name
    if np.ptp(x) == 0:
        raise BadRecord(
            f"{name}: the position never changes ({x[0]:.6g} m): without motion nothing is "
            "known about friction; record a motion in both directions"
        )
    values = record.signals["i" if record.current_alone else "u"]
    if np.ptp(values) == 0 and values[0] == 0:
        what = "the current i" if record.current_alone else "the command u"
        raise BadRecord(f"{name}: {what} is zero all the time")
    yield from record.notes
    highest, half = carried(record), 0.5 / record.step
    if highest < half:
        yield (
            f"the position has no content above {highest:.3g} Hz, of the {half:.4g} Hz possible "
            "with its sampling: it was filtered or interpolated"
        )
    for column in (c for c in ("u", "i") if c in record.signals):
        share = np.mean(clipped(record.signals[column]))
        if share > _CLIPPED:
            yield (
                f"{column} is at its largest value in {100 * share:.0f} % of the samples: clipped? "
                "Clipped samples give no information"
            )
    pace = np.diff(np.convolve(x, np.ones(21) / 21, "valid"))
    some = 0.05 * np.abs(pace).max()
    if not (np.any(pace > some) and np.any(pace < -some)):
        yield (
            "moves in one direction only: effects at reversals, or with the direction, cannot be "
            "distinguished from a constant force"
        )


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
    """Frequency up to which the position carries information [Hz]."""
    x, half = record.x, 0.5 / record.step
    if record.resolution:
        return half
    every = max(_straight_between(x), round(len(x) / len(held_samples(x))))
    return half / every if every > 1 else _filtered_at(x, record.step)


def _straight_between(x: Vector) -> int:
    """Number of samples between bends of a linearly interpolated position; else 1."""
    bends = np.abs(np.diff(x, 2))
    bent = np.flatnonzero(bends > _STRAIGHT * bends.max())
    if not 10 < len(bent) < 0.7 * len(bends):
        return 1
    apart = np.diff(bent)
    every = int(np.median(apart))
    return every if np.mean(apart % every == 0) > _REGULAR else 1


def _filtered_at(x: Vector, step: float) -> float:
    """Frequency above which the spectrum falls faster than in any drive [Hz]; else half the rate.

    With motor and springs, acceleration falls by less than 20 dB per octave; a stop band is 40 dB
    below the spectrum at slightly lower frequencies, and remains there.
    """
    half = 0.5 / step
    segment = min(_SEGMENT, len(x) // 4)
    lines, power = welch(np.diff(x, 2), 1 / step, "blackmanharris", segment, detrend=False)
    lines, power = lines[1:-1], power[1:-1]
    of_position = power / (2 * np.sin(np.pi * lines * step)) ** 4
    lowest = _LEAKS / (segment * step)
    octaves = _BANDS * np.log2(_HIGHEST * half / (2 * lowest))
    for k in range(int(octaves) + 1 if octaves >= 0 else 0):
        edge = 2 * lowest * 2 ** (k / _BANDS)
        below = (lines > 0.5 * edge) & (lines < 0.9 * edge)
        above = lines > min(1.25 * edge, 0.5 * (edge + half))
        beneath, left = np.median(power[below]), np.median(power[above & (lines < 2 * edge)])
        rests = of_position[above].max() <= 4 * np.median(of_position[below]) * _NOTHING
        if left < _NOTHING * beneath and rests:
            return float(edge)
    return half
