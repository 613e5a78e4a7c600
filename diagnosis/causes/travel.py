"""Where a study's motion went: what position-dependent causes need to know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import sympy as sp
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from ...records.resolution import resolution_of
from ...solver.component import Parameter, symbol
from ..drive import Drive
from ..modelled_record import ModelledRecord
from .cause import DRY, FRICTION, RELAXATION, Courses, Values, Vector, parameter

_FEWEST_PERIODS = 2  # in the travel
_MOST_PERIODS = 250
_SHORTEST_PERIOD = 5e-5  # m; shorter ones are an encoder's own error
_FINER = 5  # periods that are tried, to each whole one in the travel
_CELLS = 4096  # of the travel: 16 in the shortest period
_PEAKS = 6  # of most power over what lies around them
_STRONGEST = 3  # of most power: what is swift may hide between its own multiples
_AROUND = 75  # fifths of a period of the travel
_CONSTANT = 0.05  # of a speed, by which the longest part of a record differs
_HARMONICS, _BESIDE = 4, 3.0  # of rounding, and how far around each


def viscous_share(name: str) -> Parameter:
    """How much of the viscous friction goes along with the dry: lubricant may be the same
    everywhere while the surfaces are not."""
    return parameter(name, "1", "share of the viscous friction that changes as well")


def changing(name: str, course: sp.Expr) -> sp.Expr:
    """Friction of which a share changes along a course: the dry part, and `name` of the rest.

    Where the law has bristles, its level changes: what holds the bristles gives way with them.
    """
    rate = symbol("v") * sp.diff(course, symbol("x"))
    return DRY * (course + RELAXATION * rate) + symbol(name) * (FRICTION - DRY) * course


def either_way(values: list[Values], name: str) -> list[Values]:
    """Each of them for the dry friction alone and for all of it."""
    return [{**v, name: share} for v in values for share in (0.0, 1.0)]


class Wave(NamedTuple):
    name: str
    kind: str
    course: sp.Expr


def waves(per_metre: str, harmonics: Sequence[int]) -> Iterator[Wave]:
    """Cosine and sine of each multiple of as many swings; of several, names have its number."""
    for times in harmonics:
        angle = 2 * sp.pi * times * symbol(per_metre) * symbol("x")
        suffix = f"_{times}" if len(harmonics) > 1 else ""
        yield Wave(f"cos{suffix}", "cosine", sp.cos(angle))
        yield Wave(f"sin{suffix}", "sine", sp.sin(angle))


def middle_and_half(courses: Courses) -> tuple[float, float]:
    """Middle of the travel and half its length [m]."""
    low = min(float(c.x.min()) for c in courses)
    high = max(float(c.x.max()) for c in courses)
    return 0.5 * (low + high), max(0.5 * (high - low), 1e-9)


def fast_speed(courses: Courses) -> float:
    """Speed that the records hardly exceed [m/s]."""
    return float(np.quantile(np.abs(np.concatenate([c.v for c in courses])), 0.98))


def periods(courses: Courses, model: Drive, name: str, harmonics: Sequence[int]) -> list[Values]:
    """Swings per metre to try: those of the screw's turn, and the strongest of the record.

    Those of forces that change sign with the velocity and of forces that do not: whichever it is,
    a cause of the other kind has to be tried there, too.

    Parameters
    ----------
    name : str
        Under which the values go.
    harmonics : sequence of int
        Swings in a turn, where the model knows the turns in a metre, ``p``.
    """
    middle, half = middle_and_half(courses)
    low, way = middle - half, 2 * half
    turns = model.values.get("p")
    apart = 1.0 / (_FINER * way)  # closer ones are the same
    rounding = [beats for c in courses if (beats := _Beats.of(c)) is not None]

    def known(swing: float) -> bool:
        return not any(b.have(n * swing, _BESIDE * apart) for b in rounding for n in (1, 2))

    turning = [k * turns for k in harmonics if k * turns * way > _FEWEST_PERIODS] if turns else []
    found = list(filter(known, turning))
    tried = np.arange(_FEWEST_PERIODS * _FINER, _MOST_PERIODS * _FINER)
    swings = tried / (_FINER * way)
    of_force = np.array([f < 1.0 / _SHORTEST_PERIOD and known(f) for f in swings])
    for flips in (True, False):
        power = np.zeros(len(swings))
        for c in courses:
            power += _power((c.x - low) / way, _along_way(c, flips))[tried]
        for k in _strongest(power, of_force):
            if all(abs(swings[k] - f) > apart for f in found):
                peak = _peak(courses, float(swings[k]), apart, flips)
                found += [peak] * known(peak)
    return [{name: f} for f in found]


class _Beats(NamedTuple):
    """What rounding to counts makes at a constant speed: it beats with the samples.

    A sample is so many counts and a fraction after the one before; what is rounded away comes again
    after one over the fraction, its harmonics after that of their multiples. A force that is told
    once in a window is seen alike at all frequencies that differ by whole windows.

    Attributes
    ----------
    way : float
        Of a window [m].
    shares : list of float
        Of a window's frequency, 0 to 1/2.
    """

    way: float
    shares: list[float]

    @classmethod
    def of(cls, course: ModelledRecord) -> _Beats | None:
        """Those of a course, whose speed is the same for more than half of it; None for others."""
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
        """Whether a number of periods per metre is seen as one of them, or as close to it."""
        share = abs(swing * self.way - round(swing * self.way))
        return any(abs(share - own) < around * self.way for own in self.shares)


def _strongest(power: Vector, known: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Where a spectrum has its peaks."""
    # peaks over what lies around them: slow structure has more power at few periods
    rises = np.where(known, power / median_filter(power, _AROUND, mode="nearest"), 0.0)
    power = np.where(known, power, 0.0)
    inner = np.flatnonzero((rises[1:-1] > rises[:-2]) & (rises[1:-1] > rises[2:])) + 1
    return np.union1d(
        inner[np.argsort(-rises[inner])][:_PEAKS], inner[np.argsort(-power[inner])][:_STRONGEST]
    )


def _along_way(course: ModelledRecord, flips: bool) -> Vector:
    """What is unknown, per way and not per time: a rest has none, shape (n,)."""
    speed = course.v if flips else np.abs(course.v)
    whole = float(np.sum(np.abs(speed)))
    mean = float(course.unknown @ speed) / max(whole, 1e-300)
    return np.asarray(course.unknown * speed - mean * np.abs(speed))


def _power(place: Vector, force: Vector) -> Vector:
    """How much of a force swings with the place, 0 to 1 over the travel, by fifths of a period."""
    cell = np.minimum((place * _CELLS).astype(int), _CELLS - 1)
    summed = np.bincount(cell, force, _CELLS)
    return np.asarray(np.abs(np.fft.rfft(summed, _FINER * _CELLS)) ** 2)


def _peak(courses: Courses, swings: float, apart: float, flips: bool) -> float:
    """Where around there the record has most power [1/m]."""

    # what is unknown is told once in a window
    forces = [_along_way(c, flips)[:: c.width] for c in courses]
    places = [2j * np.pi * c.x[:: c.width] for c in courses]

    def power(tried: float) -> float:
        sums = [f @ np.exp(tried * x) for f, x in zip(forces, places, strict=True)]
        return -float(np.sum(np.abs(sums) ** 2))

    ends = (swings - apart, swings + apart)
    return float(minimize_scalar(power, bounds=ends, method="bounded", options={"maxiter": 12}).x)
