"""What explanations made without some of the data do on those data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .course import Course
from .drive_model import DriveModel
from .regression import stretches
from .residuals import Residual, residual
from .search import Situation, added_by
from .selection import LARGEST, Problem, amplitudes, choose, restricted_to

Vector = npt.NDArray[np.float64]

_FOLDS = 5
_DRAWS = 1000  # of stretches, for an interval


def _folds(courses: Sequence[Course], problem: Problem) -> npt.NDArray[np.int64]:
    """To which fold each stretch belongs: whole records, or contiguous parts of few."""
    counts = [stretches(c) for c in courses]
    if len(courses) >= _FOLDS:
        return np.repeat(np.arange(len(courses)) % _FOLDS, counts)
    return np.concatenate([np.arange(n) * _FOLDS // n for n in counts])


@dataclass(frozen=True)
class HeldOut:
    """What explanations made without some data do on those data.

    Attributes
    ----------
    residuals : list of Residual
        With none, the first, the first two ... of the causes: what a plant can have in it.
    chosen : list of tuple of str
        Names, one tuple for each fold.
    """

    residuals: list[Residual]
    chosen: list[tuple[str, ...]]


def judged(situation: Situation, problem: Problem, names: Sequence[str], members: int) -> HeldOut:
    courses = situation.courses
    fold_of = _folds(courses, problem)
    channels = len(courses[0].channels)
    limits = np.array(problem.limits) // channels
    whole = [
        Residual(np.zeros(limits[-1]), np.zeros(limits[-1]), np.zeros(limits[-1], dtype=bool))
        for _ in range(len(names) + 1)
    ]
    size = min(members + 1, LARGEST)

    def judge(fold: int) -> tuple[str, ...]:
        """Fill one fold's part of the residuals; the names chosen without it."""
        used = fold_of != fold
        choice = choose(problem, used, largest=size).best
        test = np.zeros(limits[-1], dtype=bool)
        for stretch in np.flatnonzero(~used):
            test[limits[stretch] : limits[stretch + 1]] = True
        for k, target in enumerate(whole):
            part = restricted_to(problem, choice, set(names[:k]))
            fitted = amplitudes(problem, part, used)
            added = added_by(part.members, fitted, courses)
            model = with_values(situation.model, problem, fitted)
            found = residual(courses, model, situation.noise, added)
            for a, b in (
                (target.force, found.force),
                (target.position, found.position),
                (target.telling, found.telling),
            ):
                a[test] = b[test]
        return choice.causes

    return HeldOut(whole, [judge(fold) for fold in range(_FOLDS)])


def with_values(model: DriveModel, problem: Problem, fitted: Vector) -> DriveModel:
    """A model with its values as all amplitudes, shape (c,), say."""
    return model.changed(
        {
            n: model.values[n] * max(1.0 + float(fitted[1 + j]), 0.1)
            for j, n in enumerate(problem.names)
        }
    )


@dataclass(frozen=True)
class HeldOutGain:
    """Share of the force residual's mean square that goes, and its 95 % interval."""

    share: float
    interval: tuple[float, float]


def gained(before: Residual, after: Residual, limits: npt.NDArray[np.int64]) -> HeldOutGain:
    """What one explanation gains over another, its interval from stretches drawn anew."""
    pairs = []
    for a, b in pairwise(limits):
        keep = before.telling[a:b]
        pairs.append(
            (
                float(np.sum(before.force[a:b][keep] ** 2)),
                float(np.sum(after.force[a:b][keep] ** 2)),
            )
        )
    squares = np.array(pairs)
    random = np.random.default_rng(0)
    drawn = squares[random.integers(0, len(squares), (_DRAWS, len(squares)))].sum(axis=1)
    shares = 1.0 - drawn[:, 1] / np.maximum(drawn[:, 0], 1e-300)
    total = squares.sum(axis=0)
    low, high = np.quantile(shares, [0.025, 0.975])
    share = 1.0 - float(total[1] / max(total[0], 1e-300))
    return HeldOutGain(share, (float(low), float(high)))
