"""Residual force of a law, divided by parts of the motion.

Each part is a set of columns: the acceleration, a constant, and steps over speed, over the distance
since a reversal, and over position. The part that predicts most of the
residual is taken first, then the best part for the rest. Predictions are evaluated on pieces of the
records that the columns were not fitted to, so that chance explains nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...solver.arrays import Mask, Matrix, Vector
from .intervals import Fit
from .layout import StackedRecords
from .motion_parts import least_squares, steps_of, way_since_reversal

_WORTH = 0.05  # smallest reported part, as a share of the unexplained mean square
_NEARLY = 0.7  # a simpler part with this share of the best prediction is preferred
_STEPS = 6  # over speed, way or position


@dataclass(frozen=True)
class Part:
    """A part of the unexplained force."""

    name: str  # "acceleration", "constant", "speed", "reversals", "travel" or "rest"
    # root mean square [N]; the squares of all and of the noise add up to that of the residual
    force: float
    words: str  # description, and the probable reason


@dataclass(frozen=True)
class LeftOver:
    """Residual of the force, weighted towards samples with small errors."""

    force: float  # unexplained [N]
    noise: float  # error by noise, sampling and reconstruction of the motion [N]
    parts: tuple[Part, ...]  # the largest first, then the rest


def left_over(course: StackedRecords, fit: Fit) -> LeftOver:
    """Residual force of a law along the records, by parts of the motion.

    Samples are weighted by one over their variance, which is the sum of those of the noise, of the
    motion between samples, and of the reconstruction of the motion.
    """
    spoken, noise = fit.spoken, course.fast_noise
    left = (course.force - fit.predicted)[spoken]
    if not len(left):
        return LeftOver(0.0, noise, ())
    weight = 1.0 / (max(noise, 1e-12) ** 2 + fit.hidden)[spoken]
    least = 1.0 / float(weight.mean())
    weight /= weight.sum()
    root = np.sqrt(weight)
    square = max(float(weight @ left**2) - least, 0.0)
    groups = {n: c[spoken] for n, c in _columns(course, fit).items()}
    # twenty pieces of all records: even ones are predicted from odd ones, and vice versa
    odd = (np.arange(len(spoken)) * 20 // len(spoken) % 2 == 1)[spoken]
    parts = []
    while groups and square > 0:
        gained = {n: _predicted(c, left, weight, odd) for n, c in groups.items()}
        most = max(gained.values())
        if most < _WORTH * square:
            break
        name = next(n for n, g in gained.items() if g >= _NEARLY * most)  # the simplest are first
        columns = groups.pop(name)
        amplitudes = least_squares(columns * root[:, None], left * root)
        left = left - columns @ amplitudes
        parts.append(Part(name, math.sqrt(gained[name]), _words(name, amplitudes, course)))
    rest = max(float(weight @ left**2) - least, 0.0)
    if rest > _WORTH * square:
        parts.append(Part("rest", math.sqrt(rest), "with none of these"))
    return LeftOver(math.sqrt(square), math.sqrt(least), tuple(parts))


def _predicted(columns: Matrix, values: Vector, weight: Vector, odd: Mask) -> float:
    """Decrease of the weighted mean square by columns that were fitted to other pieces [N^2]."""
    gained, root = 0.0, np.sqrt(weight)
    for part in (odd, ~odd):
        if part.any() and not part.all():
            others = columns[~part] * root[~part, None], values[~part] * root[~part]
            followed = columns[part] @ least_squares(*others)
            gained += float(weight[part] @ (values[part] ** 2 - (values[part] - followed) ** 2))
    return gained


def _columns(course: StackedRecords, fit: Fit) -> dict[str, Matrix]:
    """Columns of each part that is not fitted, the simplest first, shape (n, columns)."""
    direction = np.sign(course.v)[:, None]
    since = [way_since_reversal(course.x[part], course.v[part]) for part in course.parts()]
    way, near = (np.concatenate(each) for each in zip(*since, strict=True))
    places = steps_of(course.x, _STEPS, np.abs(course.v) > 0)
    groups = {
        "acceleration": course.acceleration[:, None],
        "constant": np.ones((len(course.x), 1)),
        "speed": np.hstack([steps_of(course.v, _STEPS, s * course.v > 0) for s in (1.0, -1.0)]),
        "reversals": steps_of(way, _STEPS, near) * direction,
        "travel": np.hstack([places, places * direction]),
    }
    fitted = {"acceleration": fit.law.mass, "constant": fit.law.offset}
    return {k: c for k, c in groups.items() if not fitted.get(k)}


def _words(name: str, amplitudes: Vector, course: StackedRecords) -> str:
    """What a part goes with, by its coefficients [N], and its probable reason."""
    if name == "acceleration":
        right = course.mass + float(amplitudes[0])
        masses = f"a mass of {right:.4g} kg instead of {course.mass:.4g} kg would explain it"
        gain = gain_words(right, course.mass)
        return f"with the acceleration: {masses} (fit the mass: --mass fit){gain}"
    if name == "constant":
        what = "a load, gravity or the zero error of the force sensor (fit it: --offset)"
        return f"with a constant force of {amplitudes[0]:.3g} N: {what}"
    if name == "reversals":
        return "near reversals: presliding that differs from the law, or backlash"
    if name == "travel":
        even, odd = (float(np.ptp(t)) for t in (amplitudes[:_STEPS], amplitudes[_STEPS:]))
        what = "friction" if odd > even else "a force that is the same in both directions"
        change = f"{max(odd, even):.3g} N over the travel of {float(np.ptp(course.x)):.3g} m"
        return f"with the position: {what} changes by {change}"
    fast = float(np.quantile(np.abs(course.v), 0.95))
    way, worst = divmod(int(np.argmax(np.abs(amplitudes))), _STEPS)
    side = course.v[course.v < 0 if way else course.v > 0]
    edges = np.quantile(side, (worst + np.array([0, 1])) / _STEPS)
    slow = float(np.abs(edges).max()) < 0.5 * fast
    what = "the Stribeck curve" if slow else "the viscous friction"
    what += " has another shape than in the law, or friction depends on the direction"
    return f"with the speed, most from {edges[0]:.3g} to {edges[1]:.3g} m/s: {what}"


def gain_words(right: float, given: float) -> str:
    """Possible errors if the given mass is certain but differs from the fitted one; else empty."""
    if right <= 0 or given <= 0:
        return ""
    ratio = right / given
    wrong = f"the lead or the unit of the position is wrong by a factor of {math.sqrt(ratio):.4g}"
    return f"; if {given:.4g} kg is certain, the force is {ratio:.4g} times too large, or {wrong}"
