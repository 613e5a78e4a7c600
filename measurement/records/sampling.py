"""Time stamps and counters as written by loggers, and signals at equidistant instants."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .record import resolution_of

_JITTER = 0.2  # jitter, over the sampling interval, below which stamps count as equidistant
_LONGEST_GAP = 5  # most missing samples in a row
_FOLLOWED = 0.1  # share of a stamp's delay by which the equidistant instants are shifted
_LEVELS = 200  # steps of rounded stamps in a record, from which their mean rate is known
_DIGITS = 0.05  # of a rounding step, by which the written digits may differ
_ALIKE = 0.3  # difference of steps that count as equal, over the step
_COUNTERS = {2.0**bits: f"2^{bits}" for bits in range(12, 33)}
HOLES = 0.1  # largest share of missing samples or repeated stamps


def unrounded(time: Vector) -> tuple[Vector, list[str]]:
    """Time stamps in any unit that were rounded to float32, and a note; others unchanged.

    They become even if even stamps, rounded, are within the grid of float32 around them.
    """
    grid = np.spacing(np.abs(time).astype(np.float32)).astype(float)
    coarse, span = float(grid.max(initial=0.0)), float(np.ptp(time)) if len(time) else 0.0
    written = np.abs(time - time.astype(np.float32)) < _DIGITS * grid
    if span < _LEVELS * coarse or coarse * len(time) < _JITTER * span or not written.all():
        return time, []
    numbers = np.arange(len(time))
    even = np.polyval(np.polyfit(numbers, time - time[0], 1), numbers) + time[0]
    exact = coarse <= 1.0 and np.array_equal(time, np.round(time))
    if exact or np.ptp(time - even) > (1 + _DIGITS) * coarse:
        return time, []
    return even, [f"time was rounded to float32, to steps of {coarse:.3g}: even stamps were fitted"]


def unwrapped(name: str, values: Vector, turn: float | None) -> tuple[Vector, list[str]]:
    """Values made continuous at each restart, and a note; unchanged if there is no restart.

    Values restart if all of them are within one turn, or the size of a counter, and steps of nearly
    a turn are as small as the others after subtracting it. `turn` is one turn in their unit.
    """
    known = np.isfinite(values)
    steps = np.diff(values[known])
    extent = float(np.ptp(values[known])) if known.any() else 0.0
    for period in [*([abs(turn)] if turn else []), *_COUNTERS]:
        far = np.abs(steps) > 0.5 * period
        fits = 0.5 * period < extent <= period * (1 + 1e-9)
        if not fits or not far.any() or far.all():
            continue
        turns = np.round(steps / period) * far
        on = np.abs(steps - period * turns)
        if on[far].max() <= 3.0 * on[~far].max():
            out = values.copy()
            out[known] -= period * np.concatenate([[0.0], np.cumsum(turns)])
            jumps = f"{_COUNTERS.get(period, 'a turn')} {np.count_nonzero(far)} times"
            return out, [f"{name} jumps by {jumps}: it wraps around and was unwrapped"]
    return values, []


def recounted(time: Vector, x: Vector) -> tuple[Vector, str]:
    """Even time stamps with room for samples that the position shows to be lost, and a note.

    Where a sample is lost, a smooth position moves on by a multiple of its steps before and behind.
    Losses at regular distances stay: a position that is read at a lower rate than it is made looks
    like that.
    """
    steps, ticks = np.diff(x), np.diff(time)
    if np.ptp(ticks) > _JITTER * np.median(ticks):
        return time, ""
    beside = np.stack([steps[k : len(steps) - 8 + k] for k in (0, 1, 2, 3, 5, 6, 7, 8)])
    usual = np.median(beside, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, alike = steps[4:-4] / usual, beside / usual
    jump = np.round(np.nan_to_num(ratio, posinf=0.0, neginf=0.0))
    # a late value makes a small step before a large one; other losses may be near
    smooth = (alike > 1 - _ALIKE).all(axis=0) & (np.sum(alike < 1 + _ALIKE, axis=0) > 4)
    noise = float(np.median(np.abs(np.diff(x, 3)))) / 3.0
    # two steps have to be known well enough to be told from one and from three
    moving = _ALIKE * np.abs(usual) > 2.0 * max(noise, resolution_of(x))
    whole = (jump >= 2) & (jump <= _LONGEST_GAP + 1) & (np.abs(ratio - jump) < _ALIKE)
    lost = smooth & moving & whole
    places = np.flatnonzero(lost) + 5  # samples behind a jump
    apart = np.diff(places)
    rough = 2 * np.count_nonzero(smooth & moving) < np.count_nonzero(moving)
    if rough or len(places) < 3:  # the fewest whose distances may differ
        return time, ""
    if np.median(np.abs(apart - np.median(apart))) < _ALIKE * np.median(apart):
        return time, ""
    missing = np.zeros(len(time))
    missing[places] = jump[lost] - 1
    note = f"x jumps by whole samples at {len(places)} places while the time stamps are even: "
    note += "samples are missing there, and the stamps behind them were moved"
    return time + float(np.median(ticks)) * np.cumsum(missing), note


def even_out(
    name: str, signals: Mapping[str, Vector], lines: npt.NDArray[np.int64]
) -> tuple[dict[str, Vector], float, str]:
    """Signals at equidistant instants, their interval [s], and notes on changes.

    If a few samples are missing, or stamps repeat or jitter, signals are interpolated linearly.
    Samples of a column with a lower rate are placed at the nearest instant. `lines` are the numbers
    of the samples for messages.
    """
    time = signals["time"]
    steps = np.diff(time)
    for k in np.flatnonzero(steps < 0)[:1]:
        at = f"{time[k + 1]:.6g} s after {time[k]:.6g} s"
        raise BadRecord(f"{name}: time decreases in row {lines[k + 1]}: {at}")
    repeated = np.flatnonzero(steps == 0) + 1
    if len(repeated) > HOLES * len(time):
        of = f"{len(repeated)} of {len(time)} samples, the first in row {lines[repeated[0]]}"
        why = "the time stamps are coarser than the sampling; write them with more digits"
        raise BadRecord(f"{name}: time does not increase in {of}: {why}")
    kept = {n: np.delete(v, repeated) for n, v in signals.items()}
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
    holes, k = int(missing.sum()), int(np.argmax(missing))
    divide = f"elsewhere {step:.4g} s; divide the record into pieces without gaps"
    if missing[k] > _LONGEST_GAP:
        such = f"{steps[k]:.4g} s after {time[k]:.6g} s ({np.sum(missing > _LONGEST_GAP)} such)"
        raise BadRecord(f"{name}: a gap of {such}, {divide}")
    if holes > HOLES * len(time):
        such = f"{steps[uneven[0]]:.4g} s after {time[uneven[0]]:.6g} s ({len(uneven)} such)"
        raise BadRecord(f"{name}: uneven sampling: {such}, {divide}, or resample evenly")
    off = float(np.abs(time - start - step * instants).max())
    first = math.ceil((time[0] - start) / step - 1e-6)
    last = math.floor((time[-1] - start) / step + 1e-6)
    even = start + step * np.arange(first, last + 1)
    instants = np.clip(instants - first, 0, last - first)
    out = {n: _at(even, time, v, instants) for n, v in kept.items()}
    out["time"] = even
    lost = f"{holes} samples missing, {len(repeated)} with a repeated time stamp"
    off_grid = f"time stamps up to {1e3 * off:.3g} ms from an even grid"
    how = f"resampled every {1e3 * step:.4g} ms, linear between samples"
    return out, step, f"{lost}, {off_grid}: {how}"


def pieces_between_gaps(time: Vector, samples: int, lasts: float) -> tuple[list[slice], str]:
    """The pieces of at least `samples` and `lasts` [s] between the gaps of a record, and a note.

    All is one piece if the record has no gap, or no piece is long enough.
    """
    whole, steps = [slice(0, len(time))], np.diff(time)
    if not len(steps) or not np.isfinite(steps).all() or np.any(steps < 0):
        return whole, ""
    gaps = np.flatnonzero(steps > (_LONGEST_GAP + 1.5) * np.median(steps))
    edges = [0, *(gaps + 1).tolist(), len(time)]
    long = [(a, b) for a, b in pairwise(edges) if b - a >= samples]
    long = [(a, b) for a, b in long if time[b - 1] - time[a] >= lasts]
    if not len(gaps) or not long:
        return whole, ""
    lost = 100 * (1 - sum(b - a for a, b in long) / len(time))
    first = f"{len(gaps)} gaps, the first of {steps[gaps[0]]:.4g} s after {time[gaps[0]]:.6g} s"
    note = f"{first}: the record was divided there into {len(long)} pieces of at least {lasts:g} s"
    note += f"; {lost:.2g} % of its samples are in shorter ones" if lost else ""
    return [slice(a, b) for a, b in long], note


def _instants(time: Vector, step: float) -> npt.NDArray[np.int64]:
    """Numbers of the equidistant instants to which jittering stamps belong, shape (n,)."""
    numbers = np.zeros(len(time), dtype=int)
    begun = time[: round(1 / _FOLLOWED)]  # as many as are followed
    last = float(np.median(begun - step * np.arange(len(begun))))
    for k, stamp in enumerate(time[1:].tolist(), 1):  # follow the mean: jitter does not add up
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
