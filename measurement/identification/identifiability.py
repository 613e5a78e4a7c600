"""Parameters that given trials cannot identify, the reason, and a trial that would identify them.

The trial is found by calculation: its expected information at the fitted parameters is added
to that of the records, and the first candidate that makes the parameter's interval narrow
enough is named.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .fit_result import DRAWN, Fit, draw_coordinates, without_direction
from .fitted_law import BRISTLES, MASS, OFFSET
from .intervals import NARROW
from .layout import StackedRecords
from .likelihood import Problem
from .lugre_dynamics import assumed_damping
from .optimizer import Climb
from .unseen_parameters import BROKEN_AWAY, hardly_slides, peak_unseen, presliding_way

Vector = npt.NDArray[np.float64]

FORWARDS, BACKWARDS = "forwards", "backwards"

_FINE = 1 / 160  # noise of a fine position sensor, as a share of the amplitude
_FAST = 5e-4  # sampling interval of a fast acquisition [s]
_SHAKEN = 10.0  # frequency of a shaken trial [Hz]
_LONGEST = 20.0  # longest record [s]
_MADE_UP = 0.5  # others make up for it, if its error would be less than this share without them
_SLIDES = 100.0  # amplitude of a sliding motion over the presliding distance


def ways(course: StackedRecords) -> list[str]:
    """The directions in which records move, at least one of `FORWARDS` and `BACKWARDS`."""
    found = []
    for way, sign in ((FORWARDS, 1.0), (BACKWARDS, -1.0)):
        moved = np.maximum(sign * np.diff(course.x), 0.0)
        moved[course.starts[1:-1] - 1] = 0.0
        if float(moved.sum()) > 0.02 * float(np.abs(moved).max(initial=0.0)) and (
            float(np.sum(moved)) > 5e-6
        ):
            found.append(way)
    return found or [FORWARDS]


@dataclass(frozen=True)
class CandidateTrial:
    """A trial that might be added: its description and its motion.

    Attributes
    ----------
    what : str
    motions : tuple of function of ndarray [s] to ndarray [m]
        One function per record.
    duration, step, blur : float
        Duration [s], sampling interval [s], noise of the position [m].
    """

    what: str
    motions: tuple[Callable[[Vector], Vector], ...]
    duration: float
    step: float
    blur: float


def _constant(speed: float) -> Callable[[Vector], Vector]:
    rise = 0.06
    return lambda t: speed * (t - rise * (1 - np.exp(-t / rise)))


def _sine(amplitude: float, omega: float) -> Callable[[Vector], Vector]:
    return lambda t: amplitude / omega * (1 - np.cos(omega * t))


def _both_ways(speeds: list[float]) -> tuple[Callable[[Vector], Vector], ...]:
    return tuple(_constant(s * v) for v in speeds for s in (1.0, -1.0))


def _size(fit: Fit, course: StackedRecords) -> tuple[float, float]:
    """Speed and travel of the machine [m/s, m]: those of its records.

    If the records show presliding only: a travel long enough to slide, moved over in a second.
    """
    ends = ("",) if fit.tied else ("_pos", "_neg")
    way = max(presliding_way(fit.law, fit.values, end) for end in ends)
    pairs = itertools.pairwise(course.starts)
    travel = max(float(np.ptp(course.x[first:end])) for first, end in pairs)
    if travel < BROKEN_AWAY * way:
        return _SLIDES * way, _SLIDES * way
    return float(np.quantile(np.abs(course.v), 0.99)), travel


def candidates(fit: Fit, parameter: str, course: StackedRecords) -> list[CandidateTrial]:
    """Candidate trials for a parameter, the simplest first, scaled to the machine.

    Parameters
    ----------
    fit : Fit
    parameter : str
    course : StackedRecords
        The records, which show the range of the machine and its sensors.
    """
    name = without_direction(parameter)
    speed, travel = _size(fit, course)
    measured = float(course.step.min()), float(np.median(course.blur))
    gentle = speed / 4
    rate = max(2 * gentle / travel, math.pi / _LONGEST)
    slow = CandidateTrial(
        f"velocity {gentle:.2g}*sin({rate:.3g} t) m/s for {math.pi / rate:.3g} s from rest in "
        "either direction",
        (_sine(gentle, rate), _sine(-gentle, rate)),
        math.pi / rate,
        *measured,
    )
    speeds, lasts = [speed * share for share in (1 / 12, 1 / 6, 1 / 3, 2 / 3, 1)], travel / speed
    fast = CandidateTrial(
        f"constant velocities of {_listed(speeds)} m/s in either direction, "
        f"{min(lasts, 5.0):.2g} s each",
        _both_ways(speeds),
        min(lasts, 5.0),
        *measured,
    )
    rate = max(2 * speed / travel, 2 / 3)
    cycles = CandidateTrial(
        f"velocity {speed:.2g}*sin({rate:.3g} t) m/s for two cycles",
        (_sine(speed, rate),),
        4 * math.pi / rate,
        *measured,
    )
    if name == "Vs":
        steps = [fit.values[parameter] * share for share in (0.3, 0.6, 1.0, 1.5)]
        lasts = min(_LONGEST, travel / steps[-1])
        crawl = CandidateTrial(
            f"constant velocities of {_listed(steps)} m/s in either direction, {lasts:.2g} s each",
            _both_ways(steps),
            lasts,
            *measured,
        )
        return [slow, crawl]
    if name == "sigma1":
        way = presliding_way(fit.law, fit.values, parameter[len(name) :]) / 4
        rate = 2 * math.pi * _SHAKEN
        shaken = CandidateTrial(
            f"velocity {way * rate:.2g}*sin({rate:.3g} t) m/s, {2 * way:.2g} m forwards and "
            f"backwards in presliding, for 5 s, force and displacement (to {way * _FINE:.1g} m) "
            "sampled "
            "together at 2 kHz (their delay must be known to 0.15 ms)",
            (_sine(way * rate, rate),),
            5.0,
            _FAST,
            way * _FINE,
        )
        return [shaken]
    if name == "sigma2":
        return [fast, slow]
    if name in ("f1", "f2", "eps_f", "eta"):
        return [slow, cycles]
    return [slow, fast, cycles]


def _listed(speeds: Sequence[float]) -> str:
    *others, last = (f"{v:.2g}" for v in speeds)
    return f"{', '.join(others)} and {last}"


def which_would_do(fit: Fit, parameter: str, course: StackedRecords) -> str:
    """The first candidate trial that would identify a parameter, or that none of them would."""
    if parameter == OFFSET:
        return "the same motion in both directions would be enough"
    if parameter == MASS:
        return "use a motion with stronger acceleration, forwards and backwards"
    options, resolution = candidates(fit, parameter, course), course.resolution
    coordinates = _plausible(fit)
    for option in options:
        expected = _expected_error(fit, coordinates, option, parameter, resolution)
        if 2 * expected <= NARROW:
            return f"{option.what} would be enough: expected within {200 * expected:.2g} %"
    return f"of {len(options)} trials tried by calculation none would be enough alone"


def _plausible(fit: Fit) -> Vector:
    """Coordinates to evaluate trials: the fit, with critical damping if sigma1 is not known."""
    coordinates = fit.coordinates.copy()
    for j, name in enumerate(fit.names if fit.law.name in BRISTLES else ()):
        if name.startswith("sigma1") and not fit.intervals[name].identified:
            sigma0 = fit.values[name.replace("sigma1", "sigma0")]
            sigma2 = fit.values[name.replace("sigma1", "sigma2")]
            coordinates[j] = math.log(max(assumed_damping(sigma0, sigma2), 1.0))
    return coordinates


def _expected_error(
    fit: Fit, coordinates: Vector, option: CandidateTrial, parameter: str, resolution: float
) -> float:
    """Relative standard error of a parameter with a further trial."""
    p = len(coordinates)
    course = _course(option, fit.noise, resolution)
    climb = Climb(Problem(course, fit.law, fit.tied), coordinates)
    force = climb.force(climb.point)
    course = replace(
        course, force=np.round(force / resolution) * resolution if resolution else force
    )
    climb.problem = Problem(course, fit.law, fit.tied)
    climb.prior_std[:p] = 1e3  # the trial alone may not identify all parameters
    information = climb.normal(climb.point).information
    alone = np.linalg.inv(np.linalg.inv(information)[:p, :p])
    before = np.linalg.inv(np.linalg.inv(fit.information)[:p, :p])
    covariance = np.linalg.inv(before + alone)
    j = fit.names.index(parameter)
    tiny = 1e-5
    base = math.log(fit.law.values_at(coordinates)[j])
    turn = np.empty(p)
    for k in range(p):
        moved = coordinates.copy()
        moved[k] += tiny
        turn[k] = (math.log(fit.law.values_at(moved)[j]) - base) / tiny
    return math.sqrt(float(turn @ covariance @ turn))


def _course(option: CandidateTrial, noise: float, resolution: float) -> StackedRecords:
    times: Vector = option.step * np.arange(round(option.duration / option.step), dtype=float)
    xs = [motion(times) for motion in option.motions]
    n, records = len(times), len(xs)
    v: list[Vector] = [np.asarray(np.gradient(x, option.step)) for x in xs]
    return StackedRecords(
        x=np.concatenate(xs),
        v=np.concatenate(v),
        inertial=np.concatenate([np.asarray(np.gradient(u, option.step)) for u in v]),
        force=np.zeros(n * records),
        blur=np.full(n * records, option.blur),
        step=np.full(records, option.step),
        shift_std=np.full(records, option.blur),
        gain_std=np.full(records, 1e-7),
        delay_std=np.full(records, option.step / math.sqrt(12)),
        starts=n * np.arange(records + 1, dtype=np.int64),
        clock=np.zeros(records, dtype=np.int64),
        resolution=resolution,
        noise=noise,
        replays=np.empty((0, 3, n * records)),
        backlash=np.zeros(records),
        still=np.zeros(n * records, dtype=bool),
    )


def why_not(fit: Fit, parameter: str, course: StackedRecords) -> str:
    """The reason why an interval is wide, from the recorded motion and from the fit's errors."""
    name = without_direction(parameter)
    way = {"_pos": FORWARDS, "_neg": BACKWARDS}.get(parameter[len(name) :], "in either direction")
    moved = ways(course)
    if way in (FORWARDS, BACKWARDS) and way not in moved:
        return f"there is no motion {way}"
    if fit.law.offset and len(moved) == 1 and name in (OFFSET, "Fc", "Fs"):
        return (
            "the records move in one direction only, where a constant force and friction "
            "cannot be distinguished"
        )
    if hardly_slides(fit, course, parameter):
        return (
            f"the block hardly slides {way}: after break-away it moves almost no distance, or at "
            "too few speeds to distinguish the fall of the Stribeck curve from the viscous slope"
        )
    if peak_unseen(fit, course, parameter):
        return (
            f"break-away is not visible {way}: the largest force is below it, or there "
            "is no visible peak of static friction"
        )
    return _confused(fit, parameter)


def _confused(fit: Fit, parameter: str) -> str:
    """What is known only together with this parameter, or that there is no such thing."""
    j = fit.names.index(parameter)
    if fit.law.name in DRAWN:
        covariance = np.cov(np.log(np.maximum(draw_coordinates(fit), 1e-300)), rowvar=False)
    else:
        covariance = np.linalg.inv(fit.information)
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    both = covariance / np.outer(size, size)
    alone = 1.0 / math.sqrt(max(float(np.linalg.pinv(both)[j, j]), 1.0))
    both[j, j] = 0.0
    other = int(np.argmax(np.abs(both[j])))
    noise = f"the noise of {fit.noise:.2g} N"
    if alone > _MADE_UP and 2 * alone * float(size[j]) > NARROW:
        return f"the force depends too little on it for {noise}, even if all else were known"
    if alone > _MADE_UP:
        return (
            f"its error by sensors, or from piece to piece of the records, is above that by {noise}"
        )
    name = [*fit.names, *["the delay between force and motion"] * len(fit.delays)][other]
    return (
        f"it and {name} are only known together (correlation {both[j, other]:.2f}); if all else "
        f"were known, its error would be {alone:.2g} of this one"
    )
