"""Forces that change along the travel: trends, and swings with the turns of screw or motor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import sympy as sp
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from ....solver.arrays import Mask, Vector
from ....solver.component import Parameter, symbol
from ...records.record import resolution_of
from ..model import Drive
from ..motion import Course
from .cause import ACTING, Cause, Courses, Grid, Mechanism, Values, force, of_friction, parameter

_FEWEST_PERIODS = 2  # fewest periods in the travel
_MOST_PERIODS = 250
_SHORTEST_PERIOD = 5e-5  # [m]; shorter periods are errors of the encoder
_FINER = 5  # frequencies tried per additional period in the travel
_CELLS = 4 * _MOST_PERIODS  # cells in the travel
_PEAKS = 6  # number of peaks with most power, and of those with most relative to surroundings
_AROUND = 75  # width of the surroundings, in fifths of a period in the travel
_CONSTANT = 0.05  # largest relative deviation of a constant speed
_HARMONICS = 4  # of rounding


def waves(
    name: str, unit: str, meaning: str, per_metre: str, harmonics: Sequence[int]
) -> dict[Parameter, sp.Expr]:
    """Cosine and sine of each harmonic; with several harmonics, names contain the number."""
    found = {}
    for times in harmonics:
        angle = 2 * sp.pi * times * symbol(per_metre) * symbol("x")
        suffix = f"_{times}" if len(harmonics) > 1 else ""
        for short, kind, wave in (("cos", "cosine", sp.cos), ("sin", "sine", sp.sin)):
            found[parameter(f"{name}_{short}{suffix}", unit, meaning.format(kind))] = wave(angle)
    return found


def middle_and_half(courses: Courses) -> tuple[float, float]:
    """Middle of the travel and half its length [m]."""
    low = min(float(c.x.min()) for c in courses)
    high = max(float(c.x.max()) for c in courses)
    return 0.5 * (low + high), max(0.5 * (high - low), 1e-9)


def fast_speed(courses: Courses) -> float:
    """Speed exceeded by only 2 % of the samples [m/s]."""
    return float(np.quantile(np.abs(np.concatenate([c.v for c in courses])), 0.98))


def periods(courses: Courses, model: Drive, name: str, harmonics: Sequence[int]) -> list[Values]:
    """Periods per metre to try: those of the screw's turn, and the strongest in the record.

    They are those of forces that change sign with the velocity and of forces that do not, because
    causes of both kinds have to be tried at each. If the model has the turns per metre, ``p``, all
    are multiples of half a turn, and `harmonics` are periods per turn.
    """
    middle, half = middle_and_half(courses)
    low, way = middle - half, 2 * half
    turns = model.values.get("p")
    apart = 1.0 / (_FINER * way)  # closer ones are the same
    rounding = [beats for c in courses if (beats := Beats.of(c)) is not None]

    def known(swing: float) -> bool:
        if turns and abs(swing - 0.5 * turns * max(round(2.0 * swing / turns), 1)) > apart:
            return False
        return not any(b.have(n * swing, 1.0 / way) for b in rounding for n in (1, 2))

    turning = [k * turns for k in harmonics if k * turns * way > _FEWEST_PERIODS] if turns else []
    found = list(filter(known, turning))
    tried = np.arange(_FEWEST_PERIODS * _FINER, _MOST_PERIODS * _FINER)
    swings = tried / (_FINER * way)
    of_force = np.array([f < 1.0 / _SHORTEST_PERIOD and known(f) for f in swings])
    for flips in (True, False):
        power = [_power((c.x - low) / way, _along_way(c, flips))[tried] for c in courses]
        for k in _strongest(np.sum(power, axis=0), of_force):
            if all(abs(swings[k] - f) > apart for f in found):
                peak = _peak(courses, float(swings[k]), apart, flips)
                found += [peak] * known(peak)
    return [{name: f} for f in found]


class Beats(NamedTuple):
    """Frequencies of the rounding error at a constant speed, a beat with the samples.

    The distance between two samples is an integer number of counts and a fraction. The rounding
    error repeats after one over the fraction, and its harmonics after one over the fraction of
    their multiples. A force known once per window is aliased: frequencies that differ by an integer
    number of periods per window are equal.
    """

    way: float  # distance of a window [m]
    shares: list[float]  # frequencies in periods per window, 0 to 1/2

    @classmethod
    def of(cls, course: Course) -> Beats | None:
        """Frequencies of a course with constant speed for more than half of it; None for others."""
        usual = float(np.median(course.v))
        odd = np.flatnonzero(np.abs(course.v - usual) > _CONSTANT * abs(usual))
        ends = np.concatenate([[-1], odd, [len(course.v)]])
        longest = int(np.argmax(np.diff(ends)))
        steady = slice(ends[longest] + 1, ends[longest + 1])
        count = resolution_of(course.record.x)
        if not (count and usual) or 2 * len(course.v[steady]) < len(course.v):
            return None
        speed = abs(float(np.polyfit(course.time[steady], course.x[steady], 1)[0]))
        counts = speed * course.step / count
        of_window = [course.width * k * counts for k in range(1, _HARMONICS + 1)]
        return cls(speed * course.step * course.width, [abs(s - round(s)) for s in of_window])

    def have(self, swing: float, around: float) -> bool:
        """Whether periods per metre are aliased to one of the frequencies, within `around`."""
        share = abs(swing * self.way - round(swing * self.way))
        return any(abs(share - own) < around * self.way for own in self.shares)


def _strongest(power: Vector, known: Mask) -> list[int]:
    """Indices of a spectrum's peaks."""
    # peaks relative to their surroundings: slow variation has more power at few periods
    around = np.maximum(median_filter(power, _AROUND, mode="nearest"), 1e-300)  # no force, no power
    rises = np.where(known, power / around, 0.0)
    power = np.where(known, power, 0.0)
    inner = np.flatnonzero((rises[1:-1] > rises[:-2]) & (rises[1:-1] > rises[2:])) + 1
    steepest, strongest = (inner[np.argsort(-p[inner])] for p in (rises, power))
    # a fast one may lie between its own multiples
    return sorted({*steepest[:_PEAKS].tolist(), *strongest[:_PEAKS].tolist()})


def _along_way(course: Course, flips: bool) -> Vector:
    """The unknown force per distance instead of per time, zero at rest, shape (n,)."""
    speed = course.v if flips else np.abs(course.v)
    mean = float(course.unknown @ speed) / max(float(np.sum(np.abs(speed))), 1e-300)
    return np.asarray(course.unknown * speed - mean * np.abs(speed))


def _power(place: Vector, force: Vector) -> Vector:
    """Power spectrum of a force over position, 0 to 1 in the travel, in fifths of a period."""
    cell = np.minimum((place * _CELLS).astype(int), _CELLS - 1)
    return np.asarray(np.abs(np.fft.rfft(np.bincount(cell, force, _CELLS), _FINER * _CELLS)) ** 2)


def _peak(courses: Courses, swings: float, apart: float, flips: bool) -> float:
    """Periods per metre with most power near `swings` [1/m]."""

    # the unknown force is known once per window
    forces = [_along_way(c, flips)[:: c.width] for c in courses]
    places = [2j * np.pi * c.x[:: c.width] for c in courses]

    def power(tried: float) -> float:
        sums = [f @ np.exp(tried * x) for f, x in zip(forces, places, strict=True)]
        return -float(np.sum(np.abs(sums) ** 2))

    ends = (swings - apart, swings + apart)
    return float(minimize_scalar(power, bounds=ends, method="bounded", options={"maxiter": 12}).x)


_TREND_SHARE = "trend_viscous_share"
_AT_END = "friction at the end of the travel minus that in its middle, as a share"
_SLOPE = parameter("friction_slope", "1", _AT_END)
_BOW = parameter("friction_bow", "1", "friction at both ends minus that in the middle, as a share")


def _over_travel(middle: str, half: str, *powers: Parameter) -> Mechanism:
    """Friction by powers of the position from the middle of the travel."""
    place = (symbol("x") - symbol(middle)) / symbol(half)
    first = parameter(middle, "m", "middle of the travel")
    known = first, parameter(half, "m", "half the travel", 1.0)

    def grid(courses: Courses, model: Drive) -> list[Values]:
        return [dict(zip((middle, half), middle_and_half(courses), strict=True))]

    changes = {p: place**power for power, p in enumerate(powers, start=1)}
    return of_friction(_TREND_SHARE, changes, known, grid)


def _worn_ends(courses: Courses, model: Drive) -> list[Values]:
    middle, half = middle_and_half(courses)
    return [{"x_worn": middle, "way_worn": way} for way in (half, -half)]


_INTO = (symbol("x") - symbol("x_worn")) / symbol("way_worn")
_WORN = parameter("friction_worn", "1", "additional friction at the worn end, as a share")
_FROM = parameter("x_worn", "m", "where the worn part begins")
_LONG = parameter("way_worn", "m", "length from there to the end; negative: towards -x", 1.0)
POSITION_TREND_FRICTION = Cause(
    "position_trend_friction",
    "friction changes from one end of the travel to the other",
    (
        _over_travel("x_middle", "x_half", parameter("friction_trend", "1", _AT_END)),
        _over_travel("x_bow", "bow_half", _SLOPE, _BOW),
        of_friction(_TREND_SHARE, {_WORN: (_INTO + sp.Abs(_INTO)) / 2}, (_FROM, _LONG), _worn_ends),
    ),
    confirm="slow runs over the whole travel in both directions: the difference of the forces "
    "changes along the travel",
)


_PER_TURN = 8  # most periods per turn of the screw
_SLOWLY = "move slowly over a few turns in both directions: the periodic part "


def _periods_of(per_metre: str, harmonics: tuple[int, ...]) -> tuple[tuple[Parameter], Grid]:
    """The parameter of a swing over position, and its values to try."""
    constant = parameter(per_metre, "1/m", "periods per metre", 1.0)
    tried = range(1, _PER_TURN // harmonics[-1] + 1)
    return (constant,), lambda courses, model: periods(courses, model, per_metre, tried)


def _friction_swinging(per_metre: str, harmonics: tuple[int, ...]) -> Mechanism:
    swings = waves("friction", "1", "share of friction with the {}", per_metre, harmonics)
    known = _periods_of(per_metre, harmonics)
    return of_friction("periodic_viscous_share", swings, *known, per_record=True)


POSITION_PERIODIC_FRICTION = Cause(
    "position_periodic_friction",
    "friction varies periodically along the travel, for example once per turn of the screw",
    (
        _friction_swinging("periods_per_metre", (1,)),
        _friction_swinging("double_periods_per_metre", (1, 2)),
    ),
    confirm=_SLOWLY + "changes sign with the direction",
)


def _force_swinging(
    name: str, per_metre: str, harmonics: tuple[int, ...], acting: bool = False
) -> Mechanism:
    """A ripple of the force; if `acting`, as a share of the acting force."""
    unit, of = ("1", -ACTING) if acting else ("N", sp.Integer(1))
    swings = waves(name, unit, "swing with the {} of the angle", per_metre, harmonics)
    forces = {p: of * wave for p, wave in swings.items()}
    return force(forces, *_periods_of(per_metre, harmonics), per_record=True)


TORQUE_RIPPLE = Cause(
    "torque_ripple",
    "the drive's force varies periodically with the motor's angle, the same in both directions",
    (
        _force_swinging("ripple", "ripples_per_metre", (1,)),
        _force_swinging("ripple", "double_ripples_per_metre", (1, 2)),
        _force_swinging("constant_ripple", "constant_ripples_per_metre", (1,), True),
    ),
    confirm=_SLOWLY + "keeps its sign",
)
