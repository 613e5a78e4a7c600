"""What explanations made without some of the data do on those data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .balance import calibrated, recalibrated
from .drive_model import DriveModel
from .explanation import Explanation, amplitudes, restricted_to
from .modelled_record import ModelledRecord
from .problem import Problem
from .regression import ends_of_stretches, stretches
from .residuals import Residual, residual
from .search import Situation, added_by

Vector = npt.NDArray[np.float64]

_FOLDS = 5
_LAPS = range(3, 7)  # how many laps of one motion are held out one by one
_SAME = 1e-3  # share of the motion's mean square that laps of one motion differ by at most
_SHORTEST_LAP = 1.0  # s
_SURE = 0.25  # of a gain, that its interval's lower end has to be
_DRAWS = 1000  # of stretches, for an interval


def lap(x: Vector, step: float) -> float:
    """How long a motion takes to repeat itself [s]; zero if it does not do so often enough.

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
    """How long each record's laps take [s]; empty where not all have any, or records suffice."""
    laps = [lap(c.x, c.step) for c in courses] if len(courses) < _FOLDS else []
    return laps if all(laps) else []


def parts_of(
    courses: Sequence[ModelledRecord], laps: Sequence[float], mixed: bool = False
) -> npt.NDArray[np.int64]:
    """To which fold each stretch belongs: records, laps of one motion, or parts of a record.

    Parameters
    ----------
    laps : sequence of float
        Empty where the records have none.
    mixed : bool
        Parts of a record are every fifth stretch instead of a fifth of the time: what moves fast
        only once is then not held out as a whole.
    """
    counts = [stretches(c) for c in courses]
    # an offset of a record's own can be had of that record only
    if len(courses) >= _FOLDS and not any(c.offset_name for c in courses):
        return np.repeat(np.arange(len(courses)) % _FOLDS, counts)
    if not laps:
        if mixed:
            return np.concatenate([np.arange(n) % _FOLDS for n in counts])
        return np.concatenate([np.arange(n) * _FOLDS // n for n in counts])
    begun = []
    for c, n, length in zip(courses, counts, laps, strict=True):
        duration = len(c.x) * c.step
        middles = (np.arange(n) + 0.5) * duration / n
        begun.append(np.minimum(middles // length, round(duration / length) - 1))
    return np.concatenate(begun).astype(np.int64)


@dataclass(frozen=True)
class Gain:
    """What one explanation gains over another on data held out.

    Attributes
    ----------
    share : float
        Of what the other leaves, in squares.
    interval : tuple of float
        95 %, from stretches drawn anew.
    """

    share: float
    interval: tuple[float, float]

    @property
    def certain(self) -> bool:
        return self.interval[0] > 0.0

    @property
    def sure(self) -> bool:
        """Whether it is certainly a good part of what it seems."""
        return self.interval[0] >= _SURE * self.share

    @property
    def loses(self) -> bool:
        """Whether it certainly loses."""
        return self.interval[1] < 0.0


@dataclass(frozen=True)
class HeldOut:
    """What explanations made without some data do on those data.

    Attributes
    ----------
    parts : str
        What was held out, one at a time.
    limits : ndarray of int
        Ends of the stretches that intervals are drawn from.
    none, all : Residual
        With no cause, and with all of them: what a plant can have in it.
    without, alone : dict of str to Residual
        With all causes but one, and with one only.
    """

    parts: str
    limits: npt.NDArray[np.int64]
    none: Residual
    all: Residual
    without: dict[str, Residual]
    alone: dict[str, Residual]

    def gain(self, name: str) -> Gain:
        """What a cause gains where all the others are given: of two that are one, both gain all."""
        return gained(self.without[name], self.all, self.limits)

    def gain_alone(self, name: str) -> Gain:
        """What a cause gains where no other is given."""
        return gained(self.none, self.alone[name], self.limits)

    @property
    def order(self) -> list[str]:
        """The causes, that with the largest gain first."""
        return sorted(self.without, key=lambda name: -self.gain(name).share)


def judged(
    situation: Situation,
    problem: Problem,
    best: Explanation,
    fold_of: npt.NDArray[np.int64],
    laps: bool,
) -> HeldOut:
    """Fit an explanation without each part of the data in turn, and look at that part.

    Parameters
    ----------
    best : Explanation
        Of causes only.
    fold_of : ndarray of int, shape (stretches,)
        To which part each stretch belongs, see `parts_of`.
    laps : bool
        Whether the parts are laps.
    """
    courses, names = situation.courses, best.names
    limits = ends_of_stretches(courses)
    folds = np.unique(fold_of)

    def with_causes(allowed: Sequence[str]) -> Residual:
        part = restricted_to(problem, best, set(allowed))
        samples = limits[-1]
        whole = Residual(
            np.zeros(samples), np.zeros(samples), np.zeros(samples), np.zeros(samples, bool)
        )
        for fold in folds:
            test = np.repeat(fold_of == fold, np.diff(limits))
            fitted = amplitudes(problem, part, fold_of != fold)
            added = added_by(part.members, fitted, courses)
            laid = courses if names else with_calibration(problem, fitted, courses)
            found = residual(laid, with_values(problem, fitted), added)
            for name, values in vars(whole).items():
                values[test] = getattr(found, name)[test]
        return whole

    none = with_causes(())
    everything = with_causes(names) if names else none
    if len(names) == 1:
        without, alone = {names[0]: none}, {names[0]: everything}
    else:
        without = {n: with_causes([m for m in names if m != n]) for n in names}
        alone = {n: with_causes([n]) for n in names}
    parts = f"{len(folds)} {'laps' if laps else 'parts'}"
    return HeldOut(parts, limits, none, everything, without, alone)


def with_values(problem: Problem, fitted: Vector) -> DriveModel:
    """The problem's model with its values as all amplitudes, shape (c,), say."""
    return problem.model.changed(
        {
            n: problem.model.values[n] * max(1.0 + float(fitted[1 + j]), 0.1)
            for j, n in enumerate(problem.names)
        }
    )


def with_calibration(
    problem: Problem, fitted: Vector, courses: Sequence[ModelledRecord]
) -> list[ModelledRecord]:
    """The courses with the instruments off by what all amplitudes, shape (c,), say."""
    first = 1 + len(problem.names)
    priors = calibrated(courses)
    return recalibrated(courses, dict(zip(priors, fitted[first:].tolist(), strict=False)))


def gained(before: Residual, after: Residual, limits: npt.NDArray[np.int64]) -> Gain:
    """What one explanation gains over another in force, its interval from stretches drawn anew."""
    return _gained(before.force, after.force, before.telling, limits)


def gained_ahead(before: Residual, after: Residual, limits: npt.NDArray[np.int64]) -> Gain:
    """The same of the position over a second."""
    return _gained(before.position, after.position, np.ones(len(before.position), bool), limits)


def _gained(
    before: Vector, after: Vector, keep: npt.NDArray[np.bool_], limits: npt.NDArray[np.int64]
) -> Gain:
    pairs = [
        (float(np.sum(before[a:b][keep[a:b]] ** 2)), float(np.sum(after[a:b][keep[a:b]] ** 2)))
        for a, b in pairwise(limits)
    ]
    squares = np.array(pairs)
    random = np.random.default_rng(0)
    drawn = squares[random.integers(0, len(squares), (_DRAWS, len(squares)))].sum(axis=1)
    shares = 1.0 - drawn[:, 1] / np.maximum(drawn[:, 0], 1e-300)
    total = squares.sum(axis=0)
    low, high = np.quantile(shares, [0.025, 0.975])
    share = 1.0 - float(total[1] / max(total[0], 1e-300))
    return Gain(share, (float(low), float(high)))
