"""Residual force of a law, divided by parts of the motion.

Each part is a set of columns: the acceleration, a constant, and steps over speed, over the distance
since a reversal, and over position. The part that predicts most of the
residual is taken first, then the best part for the rest. Predictions are evaluated on pieces of the
records that the columns were not fitted to, so that chance explains nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .fit_result import Fit
from .layout import StackedRecords
from .motion_parts import PARTS, least_squares, motion_parts, steps_of, way_since_reversal

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_PIECES = 20  # of all records together; even pieces are predicted from odd ones, and vice versa
_WORTH = 0.05  # smallest reported part, as a share of the unexplained mean square
_NEARLY = 0.7  # a simpler part with this share of the best prediction is preferred
_SPEEDS, _PLACES, _WAYS = 4, 10, 6  # steps


@dataclass(frozen=True)
class Part:
    """A part of the unexplained force.

    Attributes
    ----------
    name : str
        "acceleration", "constant", "speed", "reversals", "travel" or "rest".
    force : float
        Root mean square [N]; the squares of all parts and of the noise add up to that of the
        residual.
    words : str
        Description of the part, and its probable reason.
    """

    name: str
    force: float
    words: str


@dataclass(frozen=True)
class LeftOver:
    """Residual of the force.

    Attributes
    ----------
    force, noise : float
        Unexplained force, and error by noise, sampling and reconstruction of the motion, weighted
        towards samples with small errors [N].
    parts : tuple of Part
        The largest first, then the rest.
    by_motion : dict of str to float
        Root mean square residual in each part of the motion, see `PARTS` [N].
    """

    force: float
    noise: float
    parts: tuple[Part, ...]
    by_motion: dict[str, float]


def left_over(course: StackedRecords, fit: Fit, noise: float) -> LeftOver:
    """Residual force of a law along the records, by parts of the motion.

    Samples are weighted by one over their variance, which is the sum of those of the noise, of the
    motion between samples, and of the reconstruction of the motion.

    Parameters
    ----------
    course : StackedRecords
    fit : Fit
    noise : float
        Fast noise of the force [N].
    """
    spoken = fit.spoken
    residual = (course.force - fit.predicted)[spoken]
    variance = (max(noise, 1e-12) ** 2 + fit.hidden)[spoken]
    if not len(residual):
        return LeftOver(0.0, noise, (), {})
    weight = 1.0 / variance
    least = 1.0 / float(weight.mean())
    weight /= weight.sum()
    root = np.sqrt(weight)
    square = max(float(weight @ residual**2) - least, 0.0)
    groups = {n: c[spoken] for n, c in _columns(course, fit).items()}
    odd = (np.arange(len(spoken)) * _PIECES // len(spoken) % 2 == 1)[spoken]
    parts = []
    left = residual.copy()
    while groups and square > 0:
        gained = {n: _predicted(c, left, weight, odd) for n, c in groups.items()}
        most = max(gained.values())
        if most < _WORTH * square:
            break
        name = next(n for n, g in gained.items() if g >= _NEARLY * most)  # the simplest are first
        columns = groups.pop(name)
        told = least_squares(columns * root[:, None], left * root)
        left = left - columns @ told
        parts.append(Part(name, math.sqrt(gained[name]), _WORDS[name](told, course, fit)))
    rest = max(float(weight @ left**2) - least, 0.0)
    if rest > _WORTH * square:
        parts.append(Part("rest", math.sqrt(rest), "with none of these"))
    every = np.where(spoken, course.force - fit.predicted, 0.0)
    return LeftOver(math.sqrt(square), math.sqrt(least), tuple(parts), _by_motion(course, every))


def _predicted(
    columns: Matrix, values: Vector, weight: Vector, odd: npt.NDArray[np.bool_]
) -> float:
    """Decrease of the weighted mean square by columns that were fitted to other pieces [N^2]."""
    gained = 0.0
    root = np.sqrt(weight)
    for part in (odd, ~odd):
        if part.any() and not part.all():
            others = columns[~part] * root[~part, None], values[~part] * root[~part]
            told = columns[part] @ least_squares(*others)
            gained += float(weight[part] @ (values[part] ** 2 - (values[part] - told) ** 2))
    return gained


def _columns(course: StackedRecords, fit: Fit) -> dict[str, Matrix]:
    """Columns of each part, shape (n, columns)."""
    n = len(course.x)
    acceleration = course.acceleration
    way, near = np.zeros(n), np.zeros(n, dtype=bool)
    direction = np.sign(course.v)
    for r in range(course.records):
        part = slice(course.starts[r], course.starts[r + 1])
        way[part], near[part] = way_since_reversal(course.x[part], course.v[part])
    sliding = np.abs(course.v) > 0
    since = steps_of(way, _WAYS, near) * direction[:, None]
    places = steps_of(course.x, _PLACES, sliding)
    groups = {
        "acceleration": acceleration[:, None],
        "constant": np.ones((n, 1)),
        "speed": np.column_stack(
            [steps_of(course.v, _SPEEDS, s * course.v > 0) for s in (1.0, -1.0)]
        ),
        "reversals": since,
        "travel": np.column_stack([places, places * direction[:, None]]),
    }
    return {k: c for k, c in groups.items() if k not in _fitted_already(fit)}


def _fitted_already(fit: Fit) -> set[str]:
    return {n for n, yes in (("acceleration", fit.law.mass), ("constant", fit.law.offset)) if yes}


@dataclass(frozen=True)
class _Moved:
    """One record's motion, as input of `motion_parts`."""

    step: float
    v: Vector
    mean_a: Vector
    rests: npt.NDArray[np.bool_]


def _by_motion(course: StackedRecords, residual: Vector) -> dict[str, float]:
    squares, counts = dict.fromkeys(PARTS, 0.0), dict.fromkeys(PARTS, 0)
    for r in range(course.records):
        part = slice(course.starts[r], course.starts[r + 1])
        bent = course.acceleration[part]
        masks = motion_parts(
            _Moved(float(course.step[r]), course.v[part], bent, course.still[part])
        )
        for name, mask in masks.items():
            squares[name] += float(np.sum(residual[part][mask] ** 2))
            counts[name] += int(mask.sum())
    return {n: math.sqrt(squares[n] / counts[n]) for n in PARTS if counts[n]}


def _mass_words(told: Vector, course: StackedRecords, fit: Fit) -> str:
    del fit
    right = course.mass + float(told[0])
    return (
        f"with the acceleration: a mass of {right:.4g} kg instead of {course.mass:.4g} kg would "
        "explain it (fit the mass: --mass fit)" + gain_words(right, course.mass)
    )


def gain_words(right: float, given: float) -> str:
    """Possible errors if the given mass is certain but differs from the fitted one; else empty."""
    if right <= 0 or given <= 0:
        return ""
    ratio = right / given
    return (
        f"; if {given:.4g} kg is certain, the force is {ratio:.4g} times too large, or the lead or "
        f"the unit of the position is wrong by a factor of {math.sqrt(ratio):.4g}"
    )


def _constant_words(told: Vector, course: StackedRecords, fit: Fit) -> str:
    del course, fit
    return (
        f"with a constant force of {told[0]:.3g} N: a load, gravity or the zero error of "
        "the force sensor (fit it: --offset)"
    )


def _speed_words(told: Vector, course: StackedRecords, fit: Fit) -> str:
    del fit
    fast = float(np.quantile(np.abs(course.v), 0.95))
    way, worst = divmod(int(np.argmax(np.abs(told))), _SPEEDS)
    side = course.v[course.v < 0 if way else course.v > 0]
    edges = np.quantile(side, (worst + np.array([0, 1])) / _SPEEDS)
    slow = float(np.abs(edges).max()) < 0.5 * fast
    return (
        f"with the speed, most from {edges[0]:.3g} to {edges[1]:.3g} m/s: "
        + ("the Stribeck curve" if slow else "the viscous friction")
        + " has another shape than in the law, or friction depends on the direction"
    )


def _reversal_words(told: Vector, course: StackedRecords, fit: Fit) -> str:
    del told, course, fit
    return "near reversals: presliding that differs from the law, or backlash"


def _travel_words(told: Vector, course: StackedRecords, fit: Fit) -> str:
    del fit
    even, odd = told[:_PLACES], told[_PLACES:]
    what = (
        "friction"
        if np.ptp(odd) > np.ptp(even)
        else ("a force that is the same in both directions")
    )
    return (
        f"with the position: {what} changes by {max(np.ptp(odd), np.ptp(even)):.3g} N over the "
        f"travel of {float(np.ptp(course.x)):.3g} m"
    )


_WORDS: dict[str, Callable[[Vector, StackedRecords, Fit], str]] = {
    "acceleration": _mass_words,
    "constant": _constant_words,
    "speed": _speed_words,
    "reversals": _reversal_words,
    "travel": _travel_words,
}
