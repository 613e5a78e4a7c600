"""Checks of a record before it is used: resolution, bandwidth, clipping, motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import welch

from ...solver.errors import BadRecord
from .record import Record
from .resolution import held_samples

Vector = npt.NDArray[np.float64]

_CLIPPED = 0.02  # share of samples at one extreme above which a note is given
_IN_A_ROW = 3  # samples at an extreme that make a flat top
_SEGMENT = 1024  # samples of a segment
_LEAKS = 8  # unused spectral lines on each side of a strong one
_BANDS = 12  # bands per octave
_NOTHING = 1e-4  # power above a frequency, over that below it, that counts as zero
_HIGHEST = 0.8  # highest cut-off of a filter that is reported, over half the sampling rate
_STRAIGHT = 1e-3  # second difference that counts as zero, over the largest one
_REGULAR = 0.98  # least share of bends at regular distances


@dataclass(frozen=True)
class Examination:
    """Properties of a record without a model."""

    carries: float  # Hz; the position has no content above, as it was filtered or interpolated
    resolution: float  # step of a quantized position [m]; 0 if it is not quantized
    clipped: npt.NDArray[np.bool_]  # samples at which the command, or a current, is at an extreme
    notes: tuple[str, ...]  # warnings, and changes that were made; one sentence each


def examine(record: Record) -> Examination:
    """Check a record before it is used; BadRecord if it cannot be used for a diagnosis."""
    x, name = record.x, record.name
    if np.ptp(x) == 0:
        raise BadRecord(
            f"{name}: the position never changes ({x[0]:.6g} m): without motion nothing is "
            "known about friction; record a motion in both directions"
        )
    command = "i" if record.current_alone else "u"
    values = record.signals[command]
    if np.ptp(values) == 0 and values[0] == 0:
        what = "the current i" if command == "i" else "the command u"
        raise BadRecord(f"{name}: {what} is zero all the time")
    notes = [f"{name}: {note}" for note in record.notes]
    resolution = record.resolution
    carries = _carries(x, record.step, resolution)
    if carries < 0.5 / record.step:
        notes.append(
            f"{name}: the position has no content above {carries:.3g} Hz, of the "
            f"{0.5 / record.step:.4g} Hz possible with its sampling: it was "
            "filtered or interpolated"
        )
    clipped = np.zeros(len(x), dtype=bool)
    for column in ("u", "i"):
        if column in record.signals:
            cut = _clipped(record.signals[column])
            clipped |= cut
            if np.mean(cut) > _CLIPPED:
                notes.append(
                    f"{name}: {column} is at its largest value in {100 * np.mean(cut):.0f} % of "
                    "the samples: clipped? Clipped samples give no information"
                )
    if _moves_one_way(x):
        notes.append(
            f"{name}: moves in one direction only: effects at reversals, or with the direction, "
            "cannot be distinguished from a constant force"
        )
    return Examination(carries, resolution, clipped, tuple(notes))


def _moves_one_way(x: Vector) -> bool:
    pace = np.diff(np.convolve(x, np.ones(21) / 21, "valid"))
    some = 0.05 * np.abs(pace).max()
    return not (np.any(pace > some) and np.any(pace < -some))


def _clipped(values: Vector) -> npt.NDArray[np.bool_]:
    """Samples at the largest or smallest value, several in a row."""
    known = values[np.isfinite(values)]
    span = float(np.ptp(known))
    flat = np.zeros(len(values), dtype=bool)
    if span == 0:
        return flat
    for extreme in (known.max(), known.min()):
        at = np.abs(values - extreme) <= 1e-9 * span
        edges = np.diff(np.concatenate([[False], at, [False]]).astype(int))
        for first, last in zip(
            np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True
        ):
            flat[first:last] = last - first >= _IN_A_ROW
    return flat


def _carries(x: Vector, step: float, resolution: float) -> float:
    """Frequency up to which a position carries information [Hz]."""
    half = 0.5 / step
    if resolution:
        return half
    every = _straight_between(x)
    held = len(held_samples(x))
    if held < len(x):
        every = max(every, round(len(x) / held))
    return half / every if every > 1 else _filtered_at(x, step)


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

    The acceleration by a force falls by less than 20 dB per octave, with motor and springs
    included. The stop band of a filter is 40 dB below the spectrum at slightly lower frequencies,
    and remains there.
    """
    half = 0.5 / step
    segment = min(_SEGMENT, len(x) // 4)
    lines, power = welch(np.diff(x, 2), 1 / step, "blackmanharris", segment, detrend=False)
    of_position = power[1:-1] / (2 * np.sin(np.pi * lines[1:-1] * step)) ** 4
    lines, power = lines[1:-1], power[1:-1]
    lowest = _LEAKS / (segment * step)
    if 2 * lowest > _HIGHEST * half:
        return half
    octaves = int(_BANDS * np.log2(_HIGHEST * half / (2 * lowest)))
    found = half
    for k in range(octaves + 1):
        edge = 2 * lowest * 2 ** (k / _BANDS)
        below = (lines > 0.5 * edge) & (lines < 0.9 * edge)
        above = lines > min(1.25 * edge, 0.5 * (edge + half))
        beneath, left = np.median(power[below]), np.median(power[above & (lines < 2 * edge)])
        rests = of_position[above].max() <= 4 * np.median(of_position[below]) * _NOTHING
        if left < _NOTHING * beneath and rests:
            found = edge
            break
    return float(found)


def check_identifiable(records: Sequence[Record]) -> list[str]:
    """Warnings about several records, or BadRecord if they are not for one diagnosis."""
    if len({"i" in r.signals for r in records}) > 1:
        raise BadRecord(
            "some records have the current `i` and some do not; diagnose them separately"
        )
    return [note for record in records for note in examine(record).notes]
