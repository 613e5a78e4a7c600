"""Properties of an instrument from its column: resolution, noise, held values."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector

_ROUNDING = 0.4  # noise in counts up to which most of it is rounding


def resolution_of(values: Vector) -> float:
    """Step of the grid on which all values lie; 0 without a grid."""
    levels = np.unique(values)
    if len(levels) < 2:
        return 0.0
    tiny = 1e-9 * float(np.abs(levels).max())  # rounding by the text
    gaps = np.diff(levels)
    gaps = np.unique(gaps[gaps > tiny])
    step = float(gaps[0])
    for _ in range(40):  # Euclid's algorithm on all gaps at once, to within a fiftieth of the step
        rest = np.abs(gaps - step * np.round(gaps / step))
        rest = rest[rest > 0.02 * step]
        if not len(rest):
            break
        step = float(rest.min())
        if step < 4 * tiny:
            return 0.0
    counts = np.round(gaps / step)
    return float(np.sum(gaps) / np.sum(counts))


def encoder_count(position: Vector) -> float:
    """Step of a quantized position; 0 if its noise hides the grid.

    Rounding alone gives a noise of 0.29 counts. If the instrument adds about the same or more, as
    an interpolated encoder or a filter does, the edges of the counts no longer give the position.
    """
    resolution = resolution_of(position)
    return resolution if fast_noise(position) < _ROUNDING * resolution else 0.0


def fast_noise(values: Vector, where: npt.NDArray[np.bool_] | None = None) -> float:
    """Standard deviation of the part of a signal that differs from sample to sample.

    It is computed from third differences, which are nearly zero for a smooth course. Their root
    mean square is over the nine tenths of the record with the smallest values, so that a jump does
    not count as noise. `where`, shape (n - 3,), selects some of them.
    """
    third = np.abs(np.diff(values, 3))
    third = third if where is None else third[where]
    if not len(third) or not np.any(third):
        return 0.0
    ordered = np.sort(third)
    kept = ordered[: max(1, int(0.9 * len(ordered)))]
    # a normal variable cut at its 90 % quantile has 0.615 of its variance
    return float(np.sqrt(np.mean(kept**2) / 0.615 / 20.0))


def held_samples(values: Vector) -> npt.NDArray[np.int64]:
    """Indices of the samples with a new value, if a converter holds each for several samples.

    All indices if values are not held in runs of one length.
    """
    fresh = np.concatenate([[0], 1 + np.flatnonzero(np.diff(values))])
    everything = np.arange(len(values))
    if len(fresh) < 10 or len(np.unique(values)) < 0.7 * len(fresh):
        return everything  # quantized values repeat
    runs = np.diff(fresh)[1:]
    usual = int(np.median(runs))
    regular = np.mean(runs % usual == 0) > 0.9
    return fresh if usual > 1 and regular else everything
