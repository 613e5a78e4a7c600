"""Our own estimator: a friction law integrated along the recorded motion, fitted to the force.

The measured force is mass times acceleration plus the law's friction, later by an unknown part of a
sampling interval, plus noise, rounded to the load cell's resolution: the likelihood is that of the
rounded samples. The error of the position goes into the spread of a sample by the slope of friction
over displacement. Unknown besides the law's parameters, each with the spread that is known of it:

- the delay between force and motion, one for each sampling interval met;
- the displacement of each record before its first sample, of the size of the position's error, or
  free where a record does not begin without force;
- the scale of each record's position, where its sensor was calibrated with an error;
- how fast each record's body is shaken to and fro below what its position shows;
- if asked for, a constant force beside the friction, a load or the zero of the load cell.

The classical law says nothing of a block that sticks: there only the largest force before each
break-away counts, which is Fs.

The maximum is found by Fisher scoring on the logarithms of the parameters, or on coordinates that
suit the law better, see `values_of`. What is known may be held. Standard errors come
from the scores of pieces of the records (the piece is the unit of what is independent, so that
residuals that hang together within it are accounted for), corrected for their leverage, with
Student's t for their number; they are never smaller than what the likelihood says when it is not
believed in what it claims of the delays, and never smaller than `FLOOR`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ..plant.bliman_sorine import PARAMETERS as BLIMAN_SORINE
from ..plant.classical import classical
from ..plant.dahl import PARAMETERS as DAHL
from ..plant.lugre import PARAMETERS as LUGRE
from ..plant.maxwell_slip import ELEMENTS
from ..plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ..records.force_record import Record
from ..solver.component import symbol
from .friction_estimation import FrictionEstimate, Motion, estimate_friction
from .intervals import CONFIDENCE, NARROW, Interval, is_narrow
from .law_along_record import KINDS, LawValues, friction_along, score, with_play
from .replay import replayed

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

OFFSET = "offset"
"""Name of the constant force [N], against motion in +x as the plants have it."""
SHARPNESS = 1e8  # Kv of the modified law [s/m], Table 3.1; no record here says anything of it
PIECE = 1.0  # length of what is taken as independent [s]
_WALD = 0.25  # reach in logarithms beyond which the profile is followed
OWN = 4  # unknowns that each record has for itself: displacement, scale twice, shaking
_WIDE = 3.0  # spread of the logarithm of a parameter of which nothing is known
_WIDE_OFFSET = 10.0  # spread of a constant force of which nothing is known, in the largest force
_CERTAIN = 1e-9  # spread of what is held
_FREE_SHIFT = 1e-3  # [m]
_SHAKING = 5e-7  # spread of a motion below what sensors show [m/s]: 0.05 um at some hertz
# Share of the largest force: what changes by more in a sampling interval hardly counts, since the
# motion within it is not known, and wrong in the same way in all records.
_SUDDEN = 0.05
# Least standard error of a logarithm: what counts and smoothing between samples leave undone is of
# this size on records of the closed-loop rig, and more data do not make it smaller.
FLOOR = 2e-3
# Parameters that a wrong way of presliding changes by the share by which that way is wrong, or less
_ELASTIC = ("sigma0", "sigma", "alpha", "eps_f", "k1", "k2", "k3", "k4")
_SLIDING = ("lugre", "modified_lugre", "directional_lugre", "maxwell_slip", "classical")
_DRAWN = ("bliman_sorine", "maxwell_slip")  # parameters are no functions of one coordinate each
_RIGID_YIELDING = 2e-5  # way on which a law without a stiffness is taken to break away [m]
_FARTHEST = 40.0  # that drawn coordinates may lie from the fit
_NOTHING = 1e3  # spread of a sample of which the law says nothing [N]
_STILL = 3.0  # spreads of the velocity below which a block may as well stick
_AROUND = 3  # samples around a break-away of which it is not known which it was
_BROKEN_AWAY = 5.0  # ways of Fs/sigma0 until a block slides
_SLID = 50.0  # and that it must have slid in all, past them
_SPEEDS = 1.5  # least ratio of the speeds between which most of that way lies
_FALLEN = 0.7  # share of Vs that they must reach: a third of Stribeck's fall
# Share of the position's noise by which corners are wrong everywhere: a sixth of a count, whose
# noise is that of a uniform error.
_PLAY = math.sqrt(12) / 6
_UNDER = 0.01  # share by which the fit may leave Fs below Fc
_REACHED = 0.9  # share of the force of break-away that records must show
EXAMPLES = 12  # of what rebuilding a motion does
_LONGEST_TOGETHER = 100.0  # samples whose position is wrong in the same way
_CORNER = 1.3  # the smoothed position is less certain where a motion begins
_UNSEEN = 0.3  # share of a sample's change of force that the course between samples may hide
_FROM_PIECES = "maximum likelihood, errors from pieces of the records"
_STEP = 1e-4  # of finite differences, in logarithms
_LONGEST_MOVE = 0.7  # of one iteration, in logarithms
_UNTIL_COMPARED = 12  # iterations from each first guess: with five the wrong one may be ahead


@dataclass(frozen=True)
class Law:
    """A friction law as the estimator sees it: its parameters, in the order of the equations.

    Attributes
    ----------
    directional : bool
        Whether either direction has parameters of its own.
    offset : bool
        Whether a constant force is fitted beside it.
    """

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    directional: bool = False
    offset: bool = False


LAWS = {
    name: Law(
        name, tuple(p.name for p in own), tuple(p.unit for p in own), name.startswith("directional")
    )
    for name, own in {
        **dict.fromkeys(("lugre", "modified_lugre", "directional_lugre"), LUGRE),
        "dahl": DAHL,
        "bliman_sorine": BLIMAN_SORINE,
        "maxwell_slip": MAXWELL_SLIP,
        "classical": classical(symbol("v")).parameters,
    }.items()
}


def values_of(law: Law, coordinates: Vector) -> Vector:
    """Parameters from the coordinates in which they are fitted.

    Logarithms, except for two laws. Bliman-Sorine's f1 and f2 grow together as eta nears one, while
    their difference and f2*(1 - eta) hardly change: these two, eps_f and eta's odds are its
    coordinates. Maxwell slip's shares are one together, since a common factor is that of Fc and Fs:
    their ratios to the last are its coordinates, and the last's own coordinate does nothing.
    A constant force beside the law is its own coordinate [N], the last.

    Parameters
    ----------
    law : Law
    coordinates : ndarray, shape (..., p) or (..., 2 p)
        One more where the law has an offset.
    """
    if law.offset:
        of_law = values_of(replace(law, offset=False), coordinates[..., :-1])
        return np.concatenate([of_law, coordinates[..., -1:]], axis=-1)
    values = np.exp(coordinates)
    if law.name == "bliman_sorine":
        parts = []
        for k in range(0, coordinates.shape[-1], 4):
            c, b, eps_f, odds = np.moveaxis(values[..., k : k + 4], -1, 0)
            eta = odds / (1 + odds)
            f2 = b * (1 + odds)
            parts += [c + f2, f2, eps_f, eta]
        return np.stack(parts, axis=-1)
    if law.name == "maxwell_slip":
        for k in range(ELEMENTS, coordinates.shape[-1], len(law.parameters)):
            shares = values[..., k : k + ELEMENTS]
            shares[..., -1] = 1.0
            shares /= shares.sum(axis=-1, keepdims=True)
    return np.asarray(values)


def coordinates_of(law: Law, values: Vector) -> Vector:
    """The inverse of `values_of`, for one set of parameters, shape (p,)."""
    if law.name == "bliman_sorine":
        f1, f2, eps_f, eta = values
        return np.asarray(np.log([f1 - f2, f2 * (1 - eta), eps_f, eta / (1 - eta)]))
    coordinates = np.log(values)
    if law.name == "maxwell_slip":
        coordinates[ELEMENTS : 2 * ELEMENTS] -= coordinates[2 * ELEMENTS - 1]
    return np.asarray(coordinates)


@dataclass(frozen=True)
class Course:
    """Records laid end to end, as the compiled laws take them.

    Attributes
    ----------
    x, v, inertial, force, blur : ndarray, shape (n,)
        Position [m], velocity [m/s], mass times acceleration [N], measured force [N], spread of the
        position [m].
    step, shift_doubt, gain_doubt, delay_doubt : ndarray, shape (records,)
        Sampling interval [s], spread of the displacement before [m], of the position's scale [1],
        of the delay [s].
    starts : ndarray of int, shape (records + 1,)
    clock : ndarray of int, shape (records,)
        Which of the unknown delays a record has.
    count, noise : float
        Resolution of the load cell and first guess of the noise before it [N].
    replays : ndarray, shape (examples, 3, n)
        `x`, `v` and `inertial` as they are when rebuilt once more, see `replay`.
    play : ndarray, shape (records,)
        How far corners may be wrong in the same way everywhere [m].
    still : ndarray of bool, shape (n,)
        Where the block may as well stick.
    """

    x: Vector
    v: Vector
    inertial: Vector
    force: Vector
    blur: Vector
    step: Vector
    shift_doubt: Vector
    gain_doubt: Vector
    delay_doubt: Vector
    starts: npt.NDArray[np.int64]
    clock: npt.NDArray[np.int64]
    count: float
    noise: float
    replays: Matrix
    play: Vector
    still: npt.NDArray[np.bool_]

    @property
    def records(self) -> int:
        return len(self.step)

    @property
    def clocks(self) -> int:
        return int(self.clock.max()) + 1

    @property
    def level(self) -> float:
        """Size of the friction where it is large [N]."""
        return max(float(np.quantile(np.abs(self.force - self.inertial), 0.98)), 1e-9)

    def of_record(self) -> npt.NDArray[np.int64]:
        """Number of the record of each sample, shape (n,)."""
        return np.repeat(np.arange(self.records), np.diff(self.starts))


@dataclass
class Fit:
    """The most likely parameters and what is known of them.

    Attributes
    ----------
    names : tuple of str
        Parameters as fitted; ``_pos`` and ``_neg`` at their ends where directions are apart. The
        offset, where there is one, is the last.
    coordinates : ndarray, shape (p,)
    delays : ndarray, shape (clocks,)
        [s]
    shifts : ndarray, shape (records,)
        [m]
    noise : float
        Of the force before rounding [N].
    cost : float
        Minus the logarithm of likelihood and prior.
    information : ndarray, shape (p + clocks, p + clocks)
        Expected, the records' own unknowns eliminated.
    sharpest : ndarray, shape (p,)
        Variances by the likelihood alone, which believes what it says of the delays.
    covariance : ndarray, shape (p, p)
        Of the coordinates.
    freedom : ndarray, shape (p,)
        Degrees of freedom of Student's t.
    predicted : ndarray, shape (n,)
        Force along the records [N]; as measured where the law says nothing.
    spoken : ndarray of bool, shape (n,)
        Where the law says what the force is.
    """

    law: Law
    tied: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    coordinates: Vector
    delays: Vector
    shifts: Vector
    noise: float
    cost: float
    information: Matrix
    sharpest: Vector
    covariance: Matrix
    freedom: Vector
    predicted: Vector
    spoken: npt.NDArray[np.bool_]
    intervals: dict[str, Interval] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        values = values_of(self.law, self.coordinates)
        return {n: float(v) for n, v in zip(self.names, values, strict=True)}


def lay_out(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate] | None = None
) -> Course:
    """Put the records end to end.

    Parameters
    ----------
    records : sequence of Record
    estimates : sequence of FrictionEstimate, optional
        What `estimate_friction` said of each, if it was asked already.
    """
    estimates = [estimate_friction(r) for r in records] if estimates is None else list(estimates)
    lengths = [len(r.force) for r in records]
    counts = [e.force_count for e in estimates if e.force_count]
    count = float(np.median(counts)) if counts else 0.0
    rough = float(np.median([e.force_noise for e in estimates]))
    noise = max(math.sqrt(max(rough**2 - count**2 / 12, 0.0)), 0.2 * count, 1e-6)
    rates = sorted({round(math.log(r.step), 2) for r in records})
    shifts = []
    for estimate in estimates:
        known = max(_CORNER * estimate.motion.noise, 1e-9)
        shifts.append(known if estimate.from_rest else _FREE_SHIFT)

    def together(motions: Sequence[Motion]) -> Matrix:
        inertial = [r.mass * m.a for r, m in zip(records, motions, strict=True)]
        columns = [m.x for m in motions], [m.v for m in motions], inertial
        return np.stack([np.concatenate(c) for c in columns])

    # calibrations scatter alike: one that happens to fit well is no better than the others
    doubts = np.array([r.gain_doubt for r in records])
    usual = math.sqrt(float(np.mean(doubts[doubts > 0] ** 2))) if np.any(doubts > 0) else 0.0
    gain_doubt = np.where(doubts > 0, usual, 1e-7)
    x, v, inertial = together([e.motion for e in estimates])
    random = np.random.default_rng(0)
    replays = [together([replayed(e, random) for e in estimates]) for _ in range(EXAMPLES)]
    return Course(
        x=x,
        v=v,
        inertial=inertial,
        force=np.concatenate([r.force for r in records]),
        blur=np.concatenate([e.motion.blur for e in estimates]),
        step=np.array([r.step for r in records]),
        shift_doubt=np.array(shifts),
        gain_doubt=gain_doubt,
        delay_doubt=np.array([max(r.delay_doubt, 1e-9) for r in records]),
        starts=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        clock=np.array([rates.index(round(math.log(r.step), 2)) for r in records], dtype=np.int64),
        count=count,
        noise=noise,
        replays=np.stack(replays),
        play=np.array([_PLAY * e.motion.noise for e in estimates]),
        still=np.concatenate([_may_stick(e.motion) for e in estimates]),
    )


def _may_stick(motion: Motion) -> npt.NDArray[np.bool_]:
    """Where a velocity cannot be told from none, or was smoothed together with such."""
    spread = 2 * math.pi * motion.bandwidth * motion.noise
    still = np.abs(motion.v) < max(_STILL * spread, 1e-9)
    still[[0, -1]] = True  # nobody knows what was before and after
    near = max(1, round(0.25 / (motion.bandwidth * motion.step)))
    return np.asarray(np.convolve(still, np.ones(2 * near + 1), "same") > 0.5)


def _break_aways(course: Course) -> dict[int, float]:
    """Samples of the largest force before a block slides, and its direction."""
    found = {}
    friction = course.force - course.inertial
    for r in range(course.records):
        begin, end = int(course.starts[r]), int(course.starts[r + 1])
        from_rest = course.shift_doubt[r] < _FREE_SHIFT
        still = course.still[begin:end]
        first = begin + np.flatnonzero(still & ~np.append(False, still[:-1]))
        last = begin + np.flatnonzero(still & ~np.append(still[1:], False))
        for a, b in zip(first, last, strict=True):
            if b + 1 == end or (a == begin and not from_rest):
                continue
            sign = float(np.sign(course.v[b + 1]))
            peak = int(a + np.argmax(sign * friction[a : b + 1]))
            if peak >= begin + _AROUND:
                found[peak] = sign
    return found


class Problem:
    """Prediction, likelihood and information of a law on a course."""

    def __init__(self, course: Course, law: Law, tied: bool) -> None:
        self.course, self.law, self.tied = course, law, tied
        self.of_law = len(law.parameters) * (1 if tied else 2)
        self.size = self.of_law + law.offset
        # Stribeck's curve falls: coordinates of Fc and Fs, which is never less
        self.peaked: list[tuple[int, int]] = []
        if "Fs" in law.parameters:
            fc, fs = (law.parameters.index(n) for n in ("Fc", "Fs"))
            firsts = range(0, self.of_law, len(law.parameters))
            self.peaked = [(first + fc, first + fs) for first in firsts]
        self.owner = course.of_record()
        rigid = law.name == "classical"
        self.spoken = ~course.still if rigid else np.ones(len(course.x), dtype=bool)
        self.break_aways = _break_aways(course) if rigid else {}
        self.peaks = np.array(list(self.break_aways), dtype=np.int64)
        self.spoken[self.peaks] = True
        self.gradient = np.empty((2, len(course.x)))
        self.weight = np.empty((3, len(course.x)))
        self.edges = np.zeros(len(course.x), dtype=bool)
        self.edges[course.starts[:-1]] = True
        self.edges[course.starts[1:] - 1] = True
        self.clock_doubt = np.array(
            [float(np.min(course.delay_doubt[course.clock == c])) for c in range(course.clocks)]
        )
        self.per_sample = 1.0 / course.step[self.owner]
        self.begin = course.x[course.starts[:-1]][self.owner]
        ways = np.maximum.reduceat(np.abs(course.x - self.begin), course.starts[:-1])
        self.per_way = 1.0 / np.maximum(ways, 1e-9)[self.owner]

    def along(
        self,
        coordinates: Vector,
        shifts: Vector,
        gains: Matrix,
        shaking: Vector,
        motion: Matrix | None = None,
    ) -> Vector:
        """Force along the records, or another motion, before the delay, shape (n,) [N]."""
        course = self.course
        place, speed, inertial = (course.x, course.v, course.inertial) if motion is None else motion
        way = place - self.begin
        gain, bend = gains[0][self.owner], gains[1][self.owner] * self.per_way
        x = self.begin + way * (1 + gain + bend * way)
        v = speed * (1 + gain + 2 * bend * way)
        values = values_of(self.law, coordinates)
        half = len(self.law.parameters)
        forwards, backwards = values[:half], values[self.of_law - half : self.of_law]
        constant = float(values[-1]) if self.law.offset else 0.0
        sharpness = 0.0 if self.law.name == "lugre" else SHARPNESS
        law = LawValues(KINDS[self.law.name], forwards, backwards, sharpness)
        friction = friction_along(law, x, v, course.step, course.starts, shifts, shaking)
        friction += constant
        if self.law.name == "classical":
            where = ~self.spoken
            friction[where] = course.force[where] - inertial[where]
            static = half - 2  # Fs, before Vs
            for k, sign in self.break_aways.items():
                held = sign * (forwards if sign > 0 else backwards)[static]
                friction[k] = held + constant
        return friction + inertial

    def later(self, force: Vector, delays: Vector) -> Vector:
        """The force as it arrives `delays` late: a parabola through three samples."""
        part = delays[self.course.clock][self.owner] * self.per_sample
        bend = np.zeros_like(force)
        slope = np.zeros_like(force)
        slope[1:-1] = 0.5 * (force[2:] - force[:-2])
        bend[1:-1] = 0.5 * (force[2:] - 2 * force[1:-1] + force[:-2])
        slope[self.edges] = 0.0
        bend[self.edges] = 0.0
        return np.asarray(force - part * slope + part**2 * bend)

    def unseen(self, force: Vector) -> Vector:
        """Variance of a sample because of what happens between two, shape (n,) [N^2]."""
        course = self.course
        change = np.zeros_like(force)
        change[1:-1] = np.abs(force[2:] - force[:-2])
        first = course.starts[:-1]
        change[first] = 2 * np.abs(force[first + 1] - force[first])
        change[course.starts[1:] - 1] = 0.0
        change *= 0.5  # in one sampling interval
        level = max(float(np.quantile(np.abs(force), 0.98)), 1e-9)
        sudden = 1 + (change / (_SUDDEN * level)) ** 2
        variance = np.asarray((_UNSEEN * change * sudden) ** 2)
        variance[~self.spoken] = _NOTHING**2
        for k in self.peaks:
            near = course.force[k - _AROUND : k + _AROUND + 1]
            variance[k] = float(np.max(np.abs(np.diff(near)))) ** 2
        return variance

    def stribeck_gaps(self, coordinates: Vector) -> list[float]:
        """How far ln Fc is above ln Fs, where the law wants it below, by direction."""
        return [float(coordinates[fc] - coordinates[fs]) for fc, fs in self.peaked]

    def cost(self, predicted: Vector, spread: Vector) -> float:
        """Minus the log-likelihood."""
        return self._score(predicted, spread, True)

    def weigh(self, predicted: Vector, spread: Vector) -> None:
        """Leave gradient and expected information by sample."""
        self._score(predicted, spread, False)

    def _score(self, predicted: Vector, spread: Vector, cost_only: bool) -> float:
        course = self.course
        return score(
            course.force, predicted, spread, course.count, self.gradient, self.weight, cost_only
        )


@dataclass
class Point:
    """All that is unknown.

    The law's coordinates, the delays, each record's displacement before its first sample, its
    errors of scale, linear and quadratic over its way, and its shaking, the logarithm of the noise.
    """

    coordinates: Vector
    delays: Vector
    shifts: Vector
    gains: Matrix
    shaking: Vector
    noise: float

    def moved(self, step: Vector) -> Point:
        cuts = np.cumsum([len(self.coordinates), len(self.delays), len(self.shifts)])
        coordinates, delays, shifts, rest = np.split(step, cuts)
        linear, quadratic, shaking = rest[:-1].reshape(3, -1)
        return Point(
            self.coordinates + coordinates,
            self.delays + delays,
            self.shifts + shifts,
            self.gains + np.stack([linear, quadratic]),
            self.shaking + shaking,
            self.noise + float(rest[-1]),
        )


@dataclass(frozen=True)
class Pieces:
    """What one step uphill is made of.

    Attributes
    ----------
    information : ndarray, shape (unknowns, unknowns)
    slope : ndarray, shape (unknowns,)
    columns : ndarray, shape (p + clocks, n)
        Derivatives of the force.
    own : ndarray, shape (OWN, n)
        Derivatives of the force by what only the sample's record has: displacement
        before, errors of scale, shaking.
    noisy : ndarray, shape (n,)
        Derivative of the spread by the logarithm of the noise.
    """

    information: Matrix
    slope: Vector
    columns: Matrix
    own: Matrix
    noisy: Vector


class Climb:
    """Fisher scoring with Marquardt's damping from a first guess."""

    def __init__(
        self,
        problem: Problem,
        guess: Vector,
        held: Sequence[int] = (),
        hidden: Vector | None = None,
    ) -> None:
        course = problem.course
        self.problem = problem
        self.point = Point(
            guess.copy(),
            np.zeros(course.clocks),
            np.zeros(course.records),
            np.zeros((2, course.records)),
            np.zeros(course.records),
            math.log(course.noise),
        )
        self.centre = self.vector(self.point)
        wide = np.full(problem.size, _WIDE)
        wide[problem.of_law :] = _WIDE_OFFSET * course.level
        wide[list(held)] = _CERTAIN
        self.doubt = np.concatenate(
            [
                wide,
                problem.clock_doubt,
                course.shift_doubt,
                course.gain_doubt,
                0.5 * course.gain_doubt,
                np.full(course.records, _SHAKING),
                [_WIDE],
            ]
        )
        self.held = list(held)
        self.errors = np.empty((0, len(course.x)))
        self.hidden = np.zeros(len(course.x)) if hidden is None else hidden
        if hidden is None:
            self.look_back()

    @staticmethod
    def vector(point: Point) -> Vector:
        return np.concatenate(
            [
                point.coordinates,
                point.delays,
                point.shifts,
                point.gains.ravel(),
                point.shaking,
                [point.noise],
            ]
        )

    def spread(self, point: Point) -> Vector:
        """Standard deviation of each sample before rounding [N]."""
        least = max(0.1 * self.problem.course.count, 1e-7)
        return np.sqrt(max(math.exp(point.noise), least) ** 2 + self.hidden)

    def offsets(self, point: Point) -> Vector:
        return self.vector(point) - self.centre

    def prior(self, point: Point) -> float:
        beliefs = float(np.sum((self.offsets(point) / self.doubt) ** 2))
        under = (max(gap, 0.0) for gap in self.problem.stribeck_gaps(point.coordinates))
        return 0.5 * (beliefs + sum((gap / _UNDER) ** 2 for gap in under))

    def force(self, point: Point) -> Vector:
        problem = self.problem
        before = problem.along(point.coordinates, point.shifts, point.gains, point.shaking)
        return problem.later(before, point.delays)

    def force_on(self, motion: Matrix) -> Vector:
        """Force at the point reached, had the records moved so, shape (n,) [N]."""
        u = self.point
        force = self.problem.along(u.coordinates, u.shifts, u.gains, u.shaking, motion)
        return self.problem.later(force, u.delays)

    def look_back(self) -> None:
        """Learn what rebuilding the motion does to the force, at the point reached."""
        problem = self.problem
        course = problem.course
        force = self.force(self.point)
        self.hidden = problem.unseen(force)
        if not len(course.replays):
            return
        self.errors = np.array([self.force_on(m) for m in course.replays]) - force
        alone = np.mean(self.errors**2, axis=0)
        cuts = course.starts[:-1]
        together = np.mean(np.add.reduceat(self.errors, cuts, axis=1) ** 2, axis=0)
        many = together / np.maximum(np.add.reduceat(alone, cuts), 1e-30)
        self.hidden += alone * np.clip(many, 1.0, _LONGEST_TOGETHER)[problem.owner]

    def cost(self, point: Point) -> float:
        return self.problem.cost(self.force(point), self.spread(point)) + self.prior(point)

    def columns(self, point: Point) -> tuple[Matrix, Matrix]:
        """Derivatives of the force by parameters and delays, and by each record's own unknowns."""
        problem = self.problem
        course = problem.course
        p = problem.size
        base = problem.along(point.coordinates, point.shifts, point.gains, point.shaking)
        here = problem.later(base, point.delays)
        columns = np.empty((p + course.clocks, len(base)))
        for j in range(p):
            moved = point.coordinates.copy()
            moved[j] += _STEP
            force = problem.along(moved, point.shifts, point.gains, point.shaking)
            columns[j] = (problem.later(force, point.delays) - here) / _STEP
        for c in range(course.clocks):
            moved = point.delays.copy()
            tiny = 1e-3 * problem.clock_doubt[c]
            moved[c] += tiny
            columns[p + c] = (problem.later(base, moved) - here) / tiny
        own = np.empty((OWN, len(base)))
        force = problem.along(point.coordinates, point.shifts + 1e-9, point.gains, point.shaking)
        own[0] = (problem.later(force, point.delays) - here) / 1e-9
        for k in range(2):
            bent = point.gains.copy()
            bent[k] += 1e-5
            force = problem.along(point.coordinates, point.shifts, bent, point.shaking)
            own[1 + k] = (problem.later(force, point.delays) - here) / 1e-5
        tiny = 1e-3 * _SHAKING
        force = problem.along(point.coordinates, point.shifts, point.gains, point.shaking + tiny)
        own[3] = (problem.later(force, point.delays) - here) / tiny
        return columns, own

    def normal(self, point: Point) -> Pieces:
        """Information and gradient of everything unknown, priors included, and their sources."""
        problem = self.problem
        course = problem.course
        columns, own = self.columns(point)
        spread = self.spread(point)
        problem.weigh(self.force(point), spread)
        noisy = math.exp(2 * point.noise) / spread
        weight, gradient = problem.weight, problem.gradient
        q, records = len(columns), course.records
        size = q + OWN * records + 1
        cuts = course.starts[:-1]
        information = np.zeros((size, size))
        weighted = columns * weight[0]
        coupled = weight[1] * noisy  # rounding couples the noise with the force
        information[:q, :q] = weighted @ columns.T
        information[:q, -1] = columns @ coupled
        places = q + np.arange(OWN * records).reshape(OWN, records)
        slope = np.zeros(size)
        slope[:q] = columns @ gradient[0]
        for k in range(OWN):
            information[:q, places[k]] = np.add.reduceat(weighted * own[k], cuts, axis=1)
            information[places[k], -1] = np.add.reduceat(coupled * own[k], cuts)
            slope[places[k]] = np.add.reduceat(gradient[0] * own[k], cuts)
            for other in range(k, OWN):
                both = np.add.reduceat(weight[0] * own[k] * own[other], cuts)
                information[places[k], places[other]] = both
        information[-1, -1] = float(weight[2] @ noisy**2)
        information = np.triu(information) + np.triu(information, 1).T
        slope[-1] = float(gradient[1] @ noisy)
        everything = np.arange(size)
        information[everything, everything] += self.doubt**-2
        slope -= self.offsets(point) / self.doubt**2
        gaps = problem.stribeck_gaps(point.coordinates)
        for (fc, fs), gap in zip(problem.peaked, gaps, strict=True):
            if gap > 0:
                at = np.array([fc, fs])
                information[np.ix_(at, at)] += np.array([[1, -1], [-1, 1]]) / _UNDER**2
                slope[at] -= np.array([gap, -gap]) / _UNDER**2
        return Pieces(information, slope, columns, own, noisy)

    def pull(self, pieces: Pieces, weighted: Vector) -> Vector:
        """Derivatives of the prediction times a weighted residual, for everything unknown."""
        cuts = self.problem.course.starts[:-1]
        own = [np.add.reduceat(weighted * row, cuts) for row in pieces.own]
        return np.concatenate([pieces.columns @ weighted, *own, [0.0]])

    def run(self, iterations: int) -> float:
        """Go uphill; returns the cost reached."""
        damping = 1e-3
        cost = self.cost(self.point)
        for _ in range(iterations):
            pieces = self.normal(self.point)
            information, slope = pieces.information, pieces.slope
            free = np.setdiff1d(np.arange(len(slope)), self.held)
            gained = 0.0
            for _ in range(8):
                matrix = information[np.ix_(free, free)].copy()
                matrix[np.diag_indices_from(matrix)] *= 1 + damping
                step = np.zeros(len(slope))
                step[free] = np.linalg.solve(matrix, slope[free])
                logarithms = np.append(step[: self.problem.of_law], step[-1])
                far = float(np.max(np.abs(logarithms)))
                if far > _LONGEST_MOVE:
                    step *= _LONGEST_MOVE / far
                candidate = self.point.moved(step)
                tried = self.cost(candidate)
                if math.isfinite(tried) and tried < cost:
                    gained = cost - tried
                    self.point, cost = candidate, tried
                    damping = max(damping / 5, 1e-9)
                    break
                damping *= 6
            if gained < 1e-4:
                break
        return cost


def fit_along(
    records: Sequence[Record],
    law: str,
    course: Course | None = None,
    tied: bool | None = None,
    guess: Mapping[str, float] | None = None,
    follow: bool = True,
    fixed: Mapping[str, float] | None = None,
    offset: bool = False,
) -> Fit:
    """Fit the parameters of a law to the force of the records.

    Parameters
    ----------
    records : sequence of Record
    law : str
        One of `LAWS`.
    course : Course, optional
        The records laid out already.
    tied : bool, optional
        Whether both directions have the same parameters; default as the law says.
    guess : mapping of str to float, optional
        First guesses of all parameters.
    follow : bool, optional
        Whether wide intervals are followed along the profile likelihood.
    fixed : mapping of str to float, optional
        Parameters that are held at a value, by the law's names: in both directions where these
        are apart, unless the name ends in ``_pos`` or ``_neg``; and `OFFSET`.
    offset : bool, optional
        Whether a constant force [N] is fitted, too.
    """
    fixed = fixed or {}
    described = replace(LAWS[law], offset=offset or OFFSET in fixed)
    tied = not described.directional if tied is None else tied
    course = lay_out(records) if course is None else course
    problem = Problem(course, described, tied)
    best: Climb | None = None
    lowest = math.inf
    constant = fixed.get(OFFSET, _first_offset(course) if described.offset else 0.0)
    starts = _starts(course, described, constant)
    if guess:
        constant = fixed.get(OFFSET, guess.get(OFFSET, 0.0))
        starts = [np.array([guess[n] for n in described.parameters])]
    names, _ = _fitted_names(described, tied)
    held = [j for j, n in enumerate(names) if n in fixed or _bare(n) in fixed]
    hidden: Vector | None = None  # costs are compared: all guesses have the first one's
    for start in starts:
        sides = [start] if tied else [start, start.copy()]
        for side, end in zip(sides, ("",) if tied else ("_pos", "_neg"), strict=True):
            for k, name in enumerate(described.parameters):
                side[k] = fixed.get(name + end, fixed.get(name, side[k]))
        parts = [coordinates_of(LAWS[law], side) for side in sides]
        parts += [np.array([constant])] if described.offset else []
        climb = Climb(problem, np.concatenate(parts), held, hidden)
        hidden = climb.hidden
        cost = climb.run(_UNTIL_COMPARED)
        if cost < lowest:
            best, lowest = climb, cost
    if best is None:
        raise AssertionError("a law has at least one first guess")
    for _ in range(3):
        best.look_back()
        cost = best.run(25)
    fit = _summed_up(best, cost)
    return replace(fit, intervals=_intervals(fit, best, follow, fixed))


def _bare(name: str) -> str:
    """A parameter's name without its direction."""
    return name.removesuffix("_pos").removesuffix("_neg")


def _first_offset(course: Course) -> float:
    """What lies between the friction of both directions [N]; 0 where there is but one."""
    friction = course.force - course.inertial
    fast = 0.3 * float(np.quantile(np.abs(course.v), 0.98))
    sides = [friction[course.v > fast], friction[course.v < -fast]]
    return 0.5 * sum(float(np.median(s)) for s in sides) if all(map(len, sides)) else 0.0


def _starts(course: Course, law: Law, offset: float) -> list[Vector]:
    """First guesses from what the eye would take from the friction-velocity map."""
    friction = course.force - course.inertial - offset
    pull = np.abs(friction)
    speed = np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    fast = speed > 0.3 * top
    high = max(float(np.quantile(pull, 0.97)), 1e-3)
    level = max(float(np.quantile(pull[fast], 0.1)), 0.05 * high)
    slope = np.polyfit(speed[fast], pull[fast], 1) if np.ptp(speed[fast]) > 0.2 * top else (0, 0)
    viscous = float(np.clip(slope[0], 0.02 * high / top, high / top))
    stiffness = []
    for r in range(course.records):
        part = slice(course.starts[r], course.starts[r + 1])
        way = np.abs(course.x[part] - course.x[course.starts[r]])
        early = (pull[part] > 0.15 * high) & (pull[part] < 0.6 * high) & (way > course.blur[part])
        first = np.flatnonzero(pull[part] > 0.7 * high)
        early[first[0] if len(first) else len(early) :] = False
        if np.any(early):
            stiffness.append(float(np.median(pull[part][early] / way[early])))
    sigma = 1.3 * float(np.median(stiffness)) if stiffness else high / 3e-5
    mass = 1.0
    if law.name == "dahl":
        starts = [{"sigma": sigma, "Fc": high, "alpha": a} for a in (1.0, 2.0)]
    elif law.name == "bliman_sorine":
        starts = []
        for eta in (0.3, 0.7):
            f2 = 1.5 * level
            f1 = level + f2
            starts.append({"f1": f1, "f2": f2, "eps_f": (f1 / eta - f2) / sigma, "eta": eta})
    else:
        base = max(level - viscous * 0.3 * top, 0.3 * level)
        elements = {p.name: p.default for p in MAXWELL_SLIP}
        starts = [
            elements
            | {f"k{i}": sigma / ELEMENTS for i in range(1, ELEMENTS + 1)}
            | {
                "C": sigma * share * top,
                "sigma0": sigma,
                "sigma1": 2 * math.sqrt(sigma * mass),
                "sigma2": viscous,
                "Fc": base,
                "Fs": max(high, 1.1 * base),
                "Vs": share * top,
            }
            for share in (0.07, 0.25, 0.6)
        ]
    return [np.array([s[n] for n in law.parameters]) for s in starts]


def _summed_up(climb: Climb, cost: float) -> Fit:
    problem, point = climb.problem, climb.point
    course = problem.course
    pieces = climb.normal(point)
    columns, own, noisy = pieces.columns, pieces.own, pieces.noisy
    q, p = len(columns), problem.size
    inverse = np.asarray(np.linalg.inv(pieces.information), dtype=float)
    prior = climb.doubt**-2
    meat = np.diag(prior)
    shares: list[Vector] = []
    # pieces of the records; each touches the global unknowns and one record's own
    for r in range(course.records):
        begin, end = int(course.starts[r]), int(course.starts[r + 1])
        length = max(10, round(PIECE / course.step[r]))
        own_places = q + r + course.records * np.arange(OWN)
        at = np.concatenate([np.arange(q), own_places, [len(inverse) - 1]])
        for first in range(begin, end, length):
            part = slice(first, min(first + length, end))
            weight, gradient = problem.weight[:, part], problem.gradient[:, part]
            local = np.vstack([columns[:, part], own[:, part]])
            block = np.empty((len(at), len(at)))
            block[:-1, :-1] = (local * weight[0]) @ local.T
            block[:-1, -1] = block[-1, :-1] = local @ (weight[1] * noisy[part])
            block[-1, -1] = weight[2] @ noisy[part] ** 2
            said = np.append(local @ gradient[0], gradient[1] @ noisy[part])
            # what the piece says if it had no part in the estimate it is compared with
            said = np.linalg.solve(np.eye(len(at)) - block @ inverse[np.ix_(at, at)], said)
            meat[np.ix_(at, at)] += np.outer(said, said)
            arms = inverse[:p][:, at]
            shares.append(np.einsum("ij,jk,ik->i", arms, block, arms))
    robust = (inverse @ meat @ inverse)[:p, :p]
    blind = pieces.information.copy()
    clocks = np.arange(p, q)
    blind[clocks, clocks] -= _told_of_delays(climb, pieces)
    cautious = np.linalg.inv(blind)
    plain = cautious[:p, :p]
    rounding = course.count**2 / 12
    spread = climb.spread(point) ** 2 + rounding
    white = (spread - climb.hidden) / spread
    moved = [inverse[:p] @ climb.pull(pieces, problem.weight[0] * e) for e in climb.errors]
    of_motion = np.mean(np.square(moved), axis=0)
    whole = inverse[:p] ** 2 @ prior
    short = with_play(course.x, course.starts, course.play)
    more = climb.force_on(np.stack([short, course.v, course.inertial])) - climb.force(point)
    rounded = (inverse[:p] @ climb.pull(pieces, problem.weight[0] * more)) ** 2
    heard = _of_noise(climb, pieces, inverse, white)
    least = heard + of_motion + np.maximum(np.diag(plain) - np.diag(inverse)[:p], 0.0)
    for r in range(course.records):  # what a record says as a whole
        part = slice(course.starts[r], course.starts[r + 1])
        own_places = q + r + course.records * np.arange(OWN)
        at = np.concatenate([np.arange(q), own_places])
        local = np.vstack([columns[:, part], own[:, part]])
        said = inverse[:p][:, at] @ (local @ problem.gradient[0, part])
        whole += said**2
    scale = np.sqrt(np.maximum(np.maximum(least, whole) / np.diag(robust), 1.0))
    covariance = robust * np.outer(scale, scale)
    floor = np.full(p, FLOOR)
    floor[problem.of_law :] *= course.level
    covariance[np.diag_indices(p)] += floor**2 + rounded + _of_sensors(climb)
    share = np.array(shares)
    # Satterthwaite's; what is known beforehand is known for certain
    known = np.einsum("ij,j,ij->i", inverse[:p], prior, inverse[:p])
    squares = np.maximum((share**2).sum(axis=0), 1e-300)
    freedom = np.maximum((share.sum(axis=0) + known) ** 2 / squares, 2.0)
    # the records' own unknowns and the noise eliminated
    kept = np.linalg.inv(cautious[:q, :q])
    names, units = _fitted_names(problem.law, problem.tied)
    return Fit(
        law=problem.law,
        tied=problem.tied,
        names=names,
        units=units,
        coordinates=point.coordinates,
        delays=point.delays,
        shifts=point.shifts,
        noise=math.exp(point.noise),
        cost=cost,
        information=kept,
        sharpest=np.diag(inverse)[:p].copy(),
        covariance=covariance,
        freedom=freedom,
        predicted=np.where(problem.spoken, climb.force(point), course.force),
        spoken=problem.spoken,
    )


def _of_sensors(climb: Climb) -> Vector:
    """Variances that more records of the same sensors do not make smaller, by coordinate.

    A way of presliding is known no better than corners are rebuilt and scales are calibrated, which
    is wrong in the same way in all records; its share in the way is its share in the stiffness, the
    larger, the stiffer the contact.
    """
    problem, course = climb.problem, climb.problem.course
    law = problem.law
    fitted, _ = _fitted_names(law, problem.tied)
    found = values_of(law, climb.point.coordinates)
    values = {n: float(v) for n, v in zip(fitted, found, strict=True)}
    variances = np.zeros(problem.size)
    for j, name in enumerate(fitted[: problem.of_law]):
        bare = law.parameters[j % len(law.parameters)]
        if bare in _ELASTIC:
            way = presliding_way(law, values, name[len(bare) :])
            variances[j] = float(np.mean((course.play / way) ** 2 + course.gain_doubt**2))
        elif bare == "sigma1":
            sigma0, sigma1 = np.exp(climb.point.coordinates[j - 1 : j + 1])
            variances[j] = (float(problem.clock_doubt.min()) * sigma0 / sigma1) ** 2
    return variances


def presliding_way(law: Law, values: Mapping[str, float], end: str = "") -> float:
    """Way on which a law would break away if it stayed as stiff as it begins [m].

    Parameters
    ----------
    law : Law
    values : mapping of str to float
        Parameters as fitted.
    end : str, optional
        Of the parameters' names, where directions are apart.
    """
    own = {n: values[n + end] for n in law.parameters}
    if law.name == "classical":
        return _RIGID_YIELDING
    if law.name == "dahl":
        return own["Fc"] / own["sigma"]
    if law.name == "bliman_sorine":
        return (own["f1"] - own["f2"]) * own["eps_f"] / (own["f1"] / own["eta"] - own["f2"])
    if law.name == "maxwell_slip":
        return own["Fs"] / sum(own[f"k{i}"] for i in range(1, ELEMENTS + 1))
    return own["Fs"] / own["sigma0"]


def peak_unseen(fit: Fit, course: Course, parameter: str) -> bool:
    """Whether a parameter is one of break-away, and the records do not show that.

    Either they end below it, so that it is but guessed from how the loading curve bends, as a
    sensor's scale does, too; or no peak of static friction is told from sliding. Dahl's law bends
    from the first, so that without its end its beginning is a guess as well.
    """
    name = _bare(parameter)
    end = parameter[len(name) :]
    static = "Fc" if fit.law.name == "dahl" else "Fs"
    peaked = name not in ("Fs", "Vs") or (
        fit.values["Fs" + end] >= (1 + _UNDER) * fit.values["Fc" + end]
    )
    if not peaked:
        return True
    if name not in {"dahl": fit.law.parameters, "bliman_sorine": ()}.get(fit.law.name, ("Fs",)):
        return False
    friction = (fit.predicted - course.inertial)[fit.spoken] - fit.values.get(OFFSET, 0.0)
    pull = {"_pos": friction, "_neg": -friction}.get(end, np.abs(friction))
    return float(np.max(pull)) < _REACHED * fit.values[static + end]


def hardly_slides(fit: Fit, course: Course, parameter: str) -> bool:
    """Whether a parameter is one of sliding, and the records do not slide enough to tell it.

    Where they are all but presliding, the smallest error of a sensor looks like a Stribeck curve;
    and where they slide at one speed, or at speeds at which that curve has hardly fallen, what is
    left of it, its width and the viscous slope are told by nothing.
    """
    name = _bare(parameter)
    rigid = fit.law.name == "classical"
    curve = ["Fc", "Vs", "sigma2"]
    sliding = curve.copy()
    if fit.law.name == "maxwell_slip":  # shares of what is held when all elements slip
        sliding += ["C", "Fs", *(f"alpha{i}" for i in range(1, ELEMENTS + 1))]
    if name == OFFSET or fit.law.name not in _SLIDING or (name not in sliding and not rigid):
        return False
    end = parameter[len(name) :]
    yielding = presliding_way(fit.law, fit.values, end)
    dragged = with_play(course.x, course.starts, np.full(course.records, _BROKEN_AWAY * yielding))
    moves = np.diff(dragged, prepend=dragged[0])
    moves[course.starts[:-1]] = 0.0
    ways = {"_pos": np.maximum(moves, 0.0), "_neg": np.maximum(-moves, 0.0)}.get(end, np.abs(moves))
    slid = float(ways.sum())
    if slid < _SLID * yielding:
        return True
    if name not in curve:
        return False
    order = np.argsort(np.abs(course.v))
    covered = np.cumsum(ways[order]) / slid
    slow, fast = np.abs(course.v)[order][np.searchsorted(covered, (0.1, 0.9))]
    return bool(fast < _SPEEDS * slow or fast < _FALLEN * fit.values["Vs" + end])


def _of_noise(climb: Climb, pieces: Pieces, inverse: Matrix, white: Vector) -> Vector:
    """Variances of the coordinates by the noise of the force and by what is known beforehand."""
    problem = climb.problem
    p, q = problem.size, len(pieces.columns)
    owner, records = problem.owner, problem.course.records
    weight = problem.weight[0] * white
    variances = np.empty(p)
    prior = climb.doubt**-2
    for j in range(p):
        arm = inverse[j]
        own = arm[q : q + OWN * records].reshape(OWN, records)
        along = arm[:q] @ pieces.columns
        for k in range(OWN):
            along += own[k][owner] * pieces.own[k]
        variances[j] = weight @ along**2 + prior @ arm**2
    return variances


def _told_of_delays(climb: Climb, pieces: Pieces) -> Vector:
    """Information on each delay that its own records claim, all parameters free, shape (clocks,).

    It rests on millinewtons of hysteresis along thousands of samples, where no sensor and no law is
    that good, so that standard errors do without it.
    """
    problem = climb.problem
    course, p = problem.course, problem.size
    told = np.zeros(course.clocks)
    for c in range(course.clocks):
        at = np.append(np.arange(p), p + c)
        claimed = np.diag(np.append(climb.doubt[:p] ** -2, 0.0))
        for r in np.flatnonzero(course.clock == c):
            part = slice(course.starts[r], course.starts[r + 1])
            local, own = pieces.columns[at, part], pieces.own[:, part]
            weighted = own * problem.weight[0, part]
            alone = weighted @ own.T
            first = p + course.clocks + r
            places = first + course.records * np.arange(OWN)
            alone[np.diag_indices(OWN)] += climb.doubt[places] ** -2
            cross = weighted @ local.T
            claimed += (local * problem.weight[0, part]) @ local.T
            claimed -= cross.T @ np.linalg.solve(alone, cross)
        told[c] = claimed[p, p] - claimed[p, :p] @ np.linalg.solve(claimed[:p, :p], claimed[:p, p])
    return told


def _fitted_names(law: Law, tied: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    last, unit = ((OFFSET,), ("N",)) if law.offset else ((), ())
    if tied:
        return law.parameters + last, law.units + unit
    names = tuple(f"{n}_{side}" for side in ("pos", "neg") for n in law.parameters)
    return names + last, law.units * 2 + unit


def _intervals(
    fit: Fit, climb: Climb, follow: bool, fixed: Mapping[str, float]
) -> dict[str, Interval]:
    values = values_of(fit.law, fit.coordinates)
    quantile = student.ppf(0.5 + CONFIDENCE / 2, fit.freedom)
    errors = np.sqrt(np.diag(fit.covariance))
    drawn = _drawn(fit) if fit.law.name in _DRAWN else None
    blurred = blurred_elements(fit, climb.problem.course.count)
    intervals = {}
    for j, name in enumerate(fit.names):
        value, error = float(values[j]), float(errors[j])
        reach = float(quantile[j]) * error
        low: float | None
        high: float | None
        if j in climb.held:
            given = fixed[name] if name in fixed else fixed[_bare(name)]
            held = Interval(given, fit.units[j], 0.0, given, given, "given, held", True)
            intervals[name] = held
            continue
        if name == OFFSET:
            intervals[name] = Interval(
                value,
                fit.units[j],
                error,
                value - reach,
                value + reach,
                _FROM_PIECES,
                reach <= NARROW * max(abs(value), climb.problem.course.level),
            )
            continue
        if hardly_slides(fit, climb.problem.course, name):
            low, high, error = None, None, math.inf
            method = "none: a parameter of sliding, from records that hardly slide"
        elif peak_unseen(fit, climb.problem.course, name):
            low, high, error = None, None, math.inf
            method = "none: a parameter of break-away, which the records do not show"
        elif name in blurred:
            low, high, error = None, None, math.inf
            method = "none: this element is not told from its neighbours"
        elif drawn is not None:
            tail = 50 * (1 - CONFIDENCE)
            low, high = (float(b) for b in np.percentile(drawn[:, j], [tail, 100 - tail]))
            error = float(np.subtract(*np.percentile(drawn[:, j], [84.13, 15.87]))) / 2 / value
            method = _FROM_PIECES + ", drawn"
        elif reach < _WALD or not follow:
            low, high = value * math.exp(-reach), value * math.exp(reach)
            method = _FROM_PIECES
        else:
            low, high = profile_bounds(climb, fit, j, reach**2 / float(fit.sharpest[j]))
            method = "profile likelihood"
        intervals[name] = Interval(
            value=value,
            unit=fit.units[j],
            standard_error=value * error if error < 1.0 else None,
            low=low,
            high=high,
            method=method,
            identified=is_narrow(value, low, high),
        )
    return intervals


def _drawn(fit: Fit) -> Matrix:
    """Parameters drawn from Student's t around the fit, shape (draws, p); the same every time."""
    random = np.random.default_rng(0)
    try:
        root = np.linalg.cholesky(fit.covariance)
    except np.linalg.LinAlgError:  # rounded, where something is not known at all
        variances, axes = np.linalg.eigh(fit.covariance)
        root = axes * np.sqrt(np.maximum(variances, 0.0))
    normal = random.standard_normal((4000, len(root))) @ root.T
    freedom = float(fit.freedom.min())
    heavy = np.sqrt(freedom / random.chisquare(freedom, (4000, 1)))
    far = normal * heavy
    logarithms = far[:, : len(root) - fit.law.offset]
    np.clip(logarithms, -_FARTHEST, _FARTHEST, out=logarithms)
    return values_of(fit.law, fit.coordinates + far)


def blurred_elements(fit: Fit, count: float) -> set[str]:
    """Names of the parameters of Maxwell-slip elements that records do not tell from others.

    An element is told if, wherever the parameters may be, it holds more than the load cell rounds
    away and yields after the element before it and before the next.

    Parameters
    ----------
    fit : Fit
    count : float
        Resolution of the load cell [N].
    """
    if fit.law.name != "maxwell_slip":
        return set()
    names = set()
    drawn = _drawn(fit)
    for first in range(0, len(fit.names) - fit.law.offset, len(fit.law.parameters)):
        own = drawn[:, first : first + len(fit.law.parameters)]
        stiffness, shares = own[:, :ELEMENTS], own[:, ELEMENTS : 2 * ELEMENTS]
        held = shares * own[:, -2:-1]
        ways = held / stiffness
        before = np.column_stack([np.zeros(len(ways)), ways[:, :-1]])
        after = np.column_stack([ways[:, 1:], np.full(len(ways), math.inf)])
        told = np.mean((held > 2 * count) & (before < ways) & (ways < after), axis=0)
        for i in np.flatnonzero(told < CONFIDENCE):
            names |= {fit.names[first + i], fit.names[first + ELEMENTS + i]}
    return names


def profile_bounds(
    climb: Climb, fit: Fit, j: int, stretch: float
) -> tuple[float | None, float | None]:
    """Where twice the loss of log-likelihood, all else fitted anew, first exceeds `stretch`."""
    centre = float(fit.coordinates[j])
    bounds: list[float | None] = []
    for sign in (-1.0, 1.0):
        held = [j, *climb.held]
        walk = Climb(climb.problem, climb.point.coordinates, held, climb.hidden)
        walk.centre = climb.centre
        walk.doubt = climb.doubt.copy()
        walk.doubt[j] = 1e6  # the bound is the data's
        walk.point = climb.point.moved(np.zeros(len(climb.doubt)))
        base = walk.cost(walk.point)
        # all else goes along as the information at the fit says, and is then fitted
        ridge = np.linalg.inv(walk.normal(walk.point).information)[j]
        ridge /= ridge[j]
        bound: float | None = None
        before, lost_before = 0.0, 0.0
        for distance in (0.15, 0.35, 0.6, 1.0, 1.6, 2.4, 3.4):
            walk.point = walk.point.moved(sign * (distance - before) * ridge)
            walk.point.coordinates[j] = centre + sign * distance
            lost = 2 * (walk.run(3) - base)
            if lost > stretch:
                # the loss grows as the square of the distance, or nearly so
                inner, outer = math.sqrt(lost_before), math.sqrt(lost)
                share = (math.sqrt(stretch) - inner) / (outer - inner)
                bound = math.exp(centre + sign * (before + share * (distance - before)))
                break
            before, lost_before = distance, max(lost, lost_before)
        bounds.append(bound)
    return bounds[0], bounds[1]
