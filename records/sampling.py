"""Time stamps as written by loggers, and signals at equidistant instants."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .bad_record import BadRecord

Vector = npt.NDArray[np.float64]

_JITTER = 0.2  # jitter, over the sampling interval, below which stamps count as equidistant
_LONGEST_GAP = 5  # most missing samples in a row
_FOLLOWED = 0.1  # share of a stamp's delay by which the equidistant instants are shifted
_BEGINNING = 20  # samples whose stamps give the first instant
HOLES = 0.1  # largest share of missing samples or repeated stamps


def even_out(
    name: str, signals: Mapping[str, Vector], row: Callable[[int], int]
) -> tuple[dict[str, Vector], float, str]:
    """Signals at equidistant instants, their interval [s], and notes on changes.

    If a few samples are missing, or stamps repeat or jitter, signals are interpolated linearly.
    Samples of a column with a lower rate are placed at the nearest instant.

    Parameters
    ----------
    signals : mapping of str to ndarray, shape (n,)
        ``time`` and others; SI.
    row : function of int
        Number of a sample for messages; see `Table.row`.

    Raises
    ------
    BadRecord
        If time goes backwards, or too many samples are missing.
    """
    time = signals["time"]
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0)
    if len(back):
        k = int(back[0])
        raise BadRecord(
            f"{name}: time decreases in row {row(k + 1)}: {time[k + 1]:.6g} s after {time[k]:.6g} s"
        )
    repeated = np.flatnonzero(steps == 0)
    if len(repeated) > HOLES * len(time):
        raise BadRecord(
            f"{name}: time does not increase in {len(repeated)} of {len(time)} samples, the first "
            "in "
            f"row {row(int(repeated[0]) + 1)}: the time stamps are coarser than the sampling; "
            "write them with more digits"
        )
    kept = {n: np.delete(v, repeated + 1) for n, v in signals.items()}
    time = kept["time"]
    steps = np.diff(time)
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > _JITTER * step)
    if not len(uneven):
        said = f"{len(repeated)} samples with a repeated time stamp were left out"
        return kept, float(time[-1] - time[0]) / (len(time) - 1), said if len(repeated) else ""
    instants = _instants(time, step)
    for _ in range(2):
        slope, start = np.polyfit(instants, time, 1)
        step = float(slope)
        instants = np.round((time - start) / step).astype(int)
    missing = np.maximum(np.diff(instants) - 1, 0)
    k = int(np.argmax(missing))
    if missing[k] > _LONGEST_GAP:
        raise BadRecord(
            f"{name}: a gap of {steps[k]:.4g} s after {time[k]:.6g} s, but the sampling "
            f"interval is {step:.4g} s ({np.sum(missing > _LONGEST_GAP)} such); divide the record "
            "into "
            "pieces without gaps"
        )
    holes = int(missing.sum())
    if holes > HOLES * len(time):
        k = int(uneven[0])
        raise BadRecord(
            f"{name}: uneven sampling: {steps[k]:.4g} s after {time[k]:.6g} s, elsewhere "
            f"{step:.4g} s ({len(uneven)} such); resample evenly, or divide the record "
            "into pieces without gaps"
        )
    off = float(np.abs(time - start - step * instants).max())
    first = math.ceil((time[0] - start) / step - 1e-6)
    last = math.floor((time[-1] - start) / step + 1e-6)
    even = start + step * np.arange(first, last + 1)
    instants = np.clip(instants - first, 0, last - first)
    out = {n: _at(even, time, v, instants) for n, v in kept.items()}
    out["time"] = even
    said = (
        f"{holes} samples missing, {len(repeated)} with a repeated time stamp, time stamps up to "
        f"{1e3 * off:.3g} ms from an even grid: resampled every {1e3 * step:.4g} ms, linear "
        "between samples"
    )
    return out, step, said


def pieces_between_gaps(time: Vector, samples: int, lasts: float) -> tuple[list[slice], str]:
    """The sufficiently long pieces of a record between its gaps, and a note.

    Both are empty if the record has no gap, or no piece is long enough.

    Parameters
    ----------
    time : ndarray, shape (n,)
        As recorded [s].
    samples, lasts : int, float
        Least number of samples and least duration of a piece [s].
    """
    steps = np.diff(time)
    if not len(steps) or not np.isfinite(steps).all() or np.any(steps < 0):
        return [], ""
    gaps = np.flatnonzero(steps > (_LONGEST_GAP + 1.5) * np.median(steps))
    edges = [0, *(gaps + 1).tolist(), len(time)]
    pieces = [slice(a, b) for a, b in pairwise(edges)]
    long = [p for p in pieces if p.stop - p.start >= samples]
    long = [p for p in long if time[p.stop - 1] - time[p.start] >= lasts]
    if not len(gaps) or not long:
        return [], ""
    lost = 100 * (1 - sum(p.stop - p.start for p in long) / len(time))
    note = (
        f"{len(gaps)} gaps, the first of {steps[gaps[0]]:.4g} s after {time[gaps[0]]:.6g} s: the "
        f"record was divided there into {len(long)} pieces of at least {lasts:g} s"
    )
    return long, note + (f"; {lost:.2g} % of its samples are in shorter ones" if lost else "")


def _instants(time: Vector, step: float) -> npt.NDArray[np.int64]:
    """Numbers of the equidistant instants to which jittering stamps belong, shape (n,).

    Each time stamp is estimated from the mean of the previous ones, so that jitter does not add up.
    """
    numbers = np.zeros(len(time), dtype=int)
    begun = time[:_BEGINNING]
    last = float(np.median(begun - step * np.arange(len(begun))))
    for k, stamp in enumerate(time[1:].tolist(), 1):
        passed = max(0, round((stamp - last) / step))
        numbers[k] = numbers[k - 1] + passed
        last += passed * step
        late = stamp - last
        last += _FOLLOWED * late
        step += _FOLLOWED**2 / 4 * late
    return numbers


def _at(even: Vector, time: Vector, values: Vector, instants: npt.NDArray[np.int64]) -> Vector:
    known = np.isfinite(values)
    if known.all():
        return np.asarray(np.interp(even, time, values))
    out = np.full(len(even), np.nan)
    out[instants[known]] = values[known]
    return out
