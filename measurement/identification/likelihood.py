"""The likelihood of a law along records, and the search for its largest value.

The search is Fisher scoring with Marquardt's damping from a first guess.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from ...solver.arrays import Matrix, Vector
from .fitted_law import FittedLaw
from .law_along_record import LawValues, friction_along, score
from .layout import AROUND, StackedRecords, break_aways

OWN = 4  # unknowns of each single record: displacement, two of scale, vibration
UNDER = 0.01  # share by which a fitted Fs may be below Fc
_STEP = 1e-4  # of finite differences, in logarithms
_LONGEST_MOVE = 0.7  # longest step of one iteration, in logarithms
_WIDE = 3.0  # prior standard deviation of the logarithm of an unknown parameter
_WIDE_OFFSET = 10.0  # that of an unknown constant force, over the largest force
_VIBRATION = 5e-7  # that of a vibration below the sensors' noise [m/s]: 0.05 um at some Hz
_CERTAIN = 1e-9  # that of a fixed parameter


class Unknowns(NamedTuple):
    """All unknowns: views of one vector, in this order."""

    coordinates: Vector  # of the law
    delays: Vector  # [s]
    shifts: Vector  # displacement of each record before its first sample [m]
    gains: Matrix  # errors of scale, linear and quadratic over the travel, shape (2, records)
    vibration: Vector  # [m/s]
    noise: float  # its logarithm [N]


class Problem:
    """Prediction, likelihood and information of a law on a course."""

    def __init__(self, course: StackedRecords, law: FittedLaw) -> None:
        self.course, self.law = course, law
        self.of_law = len(law.names)
        self.size = self.of_law + len(law.beside)
        self.logarithms = self.of_law + law.mass
        # coordinates of Fc and Fs: Fs is never less than Fc
        self.peaked: list[tuple[int, int]] = []
        if {"Fc", "Fs"} <= set(law.parameters):
            fc, fs = (law.parameters.index(n) for n in ("Fc", "Fs"))
            firsts = range(0, self.of_law, len(law.parameters))
            self.peaked = [(first + fc, first + fs) for first in firsts]
        self.owner = course.owner()
        self.spoken = ~course.still if law.rigid else np.ones(len(course.x), dtype=bool)
        self.break_aways = break_aways(course) if law.rigid else {}
        self.peaks = np.array(list(self.break_aways), dtype=np.int64)
        self.spoken[self.peaks] = True
        self.gradient = np.empty((2, len(course.x)))
        self.weight = np.empty((3, len(course.x)))
        self.clock_std = np.array(
            [float(np.min(course.delay_std[course.clock == c])) for c in range(course.clocks)]
        )
        self.begin = course.x[course.starts[:-1]][self.owner]
        ways = np.maximum.reduceat(np.abs(course.x - self.begin), course.starts[:-1])
        self.per_way = 1.0 / np.maximum(ways, 1e-9)[self.owner]
        # of the last prediction along the records: what the friction depends on, and the friction
        self.at = self.friction = np.empty(0)
        self.kept: tuple[Matrix, tuple[Vector, Vector]] = np.empty((2, 0)), (course.x, course.v)

    def unknowns(self, vector: Vector) -> Unknowns:
        sizes = [self.size, self.course.clocks, *[self.course.records] * OWN]
        coordinates, delays, shifts, *gains, vibration, noise = np.split(vector, np.cumsum(sizes))
        return Unknowns(coordinates, delays, shifts, np.stack(gains), vibration, float(noise[0]))

    def scaled(self, gains: Matrix, motion: Matrix | None) -> tuple[Vector, Vector]:
        """Positions and velocities with the errors of scale; those of the records are kept."""
        if motion is None and np.array_equal(self.kept[0], gains):
            return self.kept[1]
        place, speed = (self.course.x, self.course.v) if motion is None else motion[:2]
        way = place - self.begin
        gain, bend = gains[0][self.owner], gains[1][self.owner] * self.per_way
        moved = self.begin + way * (1 + gain + bend * way), speed * (1 + gain + 2 * bend * way)
        if motion is None:
            self.kept = gains.copy(), moved
        return moved

    def before(self, u: Unknowns, motion: Matrix | None = None) -> Vector:
        """Force along the records, or another motion, before the delay, shape (n,) [N]."""
        course, law = self.course, self.law
        inertial = course.inertial if motion is None else motion[2]
        values = law.values_at(u.coordinates)
        half = len(law.parameters)
        forwards, backwards = values[:half], values[self.of_law - half : self.of_law]
        constant = float(values[-1]) if law.offset else 0.0
        if law.mass:
            inertial = inertial * (values[self.of_law] / course.mass)
        moved = np.concatenate([values[: self.of_law], u.gains.ravel(), u.shifts, u.vibration])
        friction = self.friction
        if motion is not None or not np.array_equal(moved, self.at):
            x, v = self.scaled(u.gains, motion)
            along = LawValues(law.name, forwards, backwards)
            starts = course.step, course.starts
            friction = friction_along(along, x, v, *starts, u.shifts, u.vibration)
        if motion is None:
            self.at, self.friction = moved, friction
        force = friction + constant
        if law.rigid:
            where = ~self.spoken
            force[where] = course.force[where] - inertial[where]
            static = half - 2  # Fs, before Vs
            for k, sign in self.break_aways.items():
                force[k] = sign * (forwards if sign > 0 else backwards)[static] + constant
        return force + inertial

    def later(self, force: Vector, delays: Vector) -> Vector:
        """The force delayed by `delays`, by a filter that keeps the size of all frequencies.

        Interpolation reduces the noise of the acceleration: the fit would then prefer a delay of
        half a sample. Before and after a record its slope goes on.
        """
        course, late = self.course, force.copy()
        for part, clock, step in zip(course.parts(), course.clock, course.step, strict=True):
            if not delays[clock]:
                continue
            samples = float(delays[clock] / step)
            own = force[part][:: 1 if samples > 0 else -1]
            c = -abs(samples) / (2 + abs(samples))  # Thiran's, for one sample more
            before = 2 * own[0] - own[30:0:-1]  # in which the filter forgets its start
            longer = np.concatenate([before, own, [2 * own[-1] - own[-2]]])
            moved, _ = lfilter([c, 1], [1, c], longer, zi=[(1 - c) * longer[0]])
            late[part] = moved[len(before) + 1 :][:: 1 if samples > 0 else -1]
        return late

    def force(self, u: Unknowns, motion: Matrix | None = None) -> Vector:
        """Predicted force [N], shape (n,)."""
        return self.later(self.before(u, motion), u.delays)

    def unseen(self, force: Vector) -> Vector:
        """Variance of a sample due to unknown motion between samples, shape (n,) [N^2].

        The error is a share of the change of force per sample. Samples with sudden changes have
        little weight, because their error is the same in all records.
        """
        course = self.course
        change = np.zeros_like(force)
        change[1:-1] = np.abs(force[2:] - force[:-2])
        first = course.starts[:-1]
        change[first] = 2 * np.abs(force[first + 1] - force[first])
        change[course.starts[1:] - 1] = 0.0
        change *= 0.5  # in one sampling interval
        level = max(float(np.quantile(np.abs(force), 0.98)), 1e-9)
        sudden = 1 + (change / (0.05 * level)) ** 2
        variance = np.asarray((0.3 * change * sudden) ** 2)
        variance[~self.spoken] = 1e3**2  # the law gives no force
        for k in self.peaks:
            near = course.force[k - AROUND : k + AROUND + 1]
            variance[k] = float(np.max(np.abs(np.diff(near)))) ** 2
        return variance

    def stribeck_gaps(self, coordinates: Vector) -> list[float]:
        """ln Fc less ln Fs by direction; the law requires a negative value."""
        return [float(coordinates[fc] - coordinates[fs]) for fc, fs in self.peaked]

    def score(self, predicted: Vector, spread: Vector, cost_only: bool) -> float:
        """Minus the log-likelihood; stores gradient and expected information of each sample."""
        force, count = self.course.force, self.course.resolution
        return score(force, predicted, spread, count, self.gradient, self.weight, cost_only)


@dataclass(frozen=True)
class Pieces:
    """Quantities for one step of the maximization."""

    information: Matrix  # shape (unknowns, unknowns)
    slope: Vector  # shape (unknowns,)
    columns: Matrix  # derivatives of the force by parameters and delays, shape (p + clocks, n)
    own: Matrix  # those by the unknowns of the sample's record, shape (OWN, n)
    noisy: Vector  # derivative of the spread by the logarithm of the noise, shape (n,)


class Climb:
    """The search from a first guess of the coordinates; those in `held` stay."""

    def __init__(
        self,
        problem: Problem,
        guess: Vector,
        held: Sequence[int] = (),
        hidden: Vector | None = None,
    ) -> None:
        course = problem.course
        self.problem, self.held = problem, list(held)
        none = np.zeros(course.clocks + OWN * course.records)
        self.centre = np.concatenate([guess, none, [math.log(course.noise)]])
        self.vector = self.centre.copy()
        wide = np.full(problem.size, _WIDE)
        wide[problem.logarithms :] = _WIDE_OFFSET * course.level
        wide[self.held] = _CERTAIN
        gain = course.gain_std
        of_records = course.shift_std, gain, 0.5 * gain, np.full(course.records, _VIBRATION)
        self.prior_std = np.concatenate([wide, problem.clock_std, *of_records, [_WIDE]])
        self.errors = np.empty((0, len(course.x)))  # of the force, by the motion's reconstruction
        self.hidden = np.zeros(len(course.x)) if hidden is None else hidden
        if hidden is None:
            self.look_back()

    @property
    def point(self) -> Unknowns:
        return self.problem.unknowns(self.vector)

    def force(self, motion: Matrix | None = None) -> Vector:
        """Force at the present point, along the records or another motion, shape (n,) [N]."""
        return self.problem.force(self.point, motion)

    def spread(self, noise: float) -> Vector:
        """Standard deviation of each sample before rounding [N], by the logarithm of the noise."""
        least = max(0.1 * self.problem.course.resolution, 1e-7)
        return np.sqrt(max(math.exp(noise), least) ** 2 + self.hidden)

    def look_back(self) -> None:
        """Compute force errors by the reconstruction of the motion, with the present parameters."""
        problem, course = self.problem, self.problem.course
        force = self.force()
        self.hidden = problem.unseen(force)
        if not len(course.replays):
            return
        self.errors = np.array([self.force(m) for m in course.replays]) - force
        alone = np.mean(self.errors**2, axis=0)
        cuts = course.starts[:-1]
        together = np.mean(np.add.reduceat(self.errors, cuts, axis=1) ** 2, axis=0)
        many = together / np.maximum(np.add.reduceat(alone, cuts), 1e-30)
        self.hidden += alone * np.clip(many, 1.0, 100.0)[problem.owner]  # of one error, at most

    def cost(self, vector: Vector) -> float:
        """Minus the logarithm of likelihood and prior."""
        u = self.problem.unknowns(vector)
        likelihood = self.problem.score(self.problem.force(u), self.spread(u.noise), True)
        beliefs = float(np.sum(((vector - self.centre) / self.prior_std) ** 2))
        under = (max(gap, 0.0) for gap in self.problem.stribeck_gaps(u.coordinates))
        return likelihood + 0.5 * (beliefs + sum((gap / UNDER) ** 2 for gap in under))

    def columns(self) -> tuple[Vector, Matrix, Matrix]:
        """The force, and its derivatives by parameters and delays, and by records' own unknowns."""
        problem = self.problem
        p, clocks, records = problem.size, problem.course.clocks, problem.course.records
        q, u = p + clocks, self.point
        base = problem.before(u)
        here = problem.later(base, u.delays)
        columns, own = np.empty((q, len(base))), np.zeros((OWN, len(base)))
        for c, tiny in enumerate(1e-3 * problem.clock_std):
            late = u.delays.copy()
            late[c] += tiny
            columns[p + c] = (problem.later(base, late) - here) / tiny
        # mass and offset first, which leave the friction as it was
        moves = [(columns[j], slice(j, j + 1), _STEP) for j in reversed(range(p))]
        effects = {0: 1e-9, 1: 1e-5, 2: 1e-5, 3: 1e-3 * _VIBRATION}
        for k in (1, 2) if problem.law.form == "dry" else effects:  # it has no deflection
            where = slice(q + k * records, q + (k + 1) * records)
            moves.append((own[k], where, effects[k]))
        for column, where, tiny in moves:
            moved = self.vector.copy()
            moved[where] += tiny
            column[:] = (problem.force(problem.unknowns(moved)) - here) / tiny
        return here, columns, own

    def normal(self) -> Pieces:
        """Information and gradient of all unknowns, with priors, and the quantities for them."""
        problem, course, u = self.problem, self.problem.course, self.point
        force, columns, own = self.columns()
        spread = self.spread(u.noise)
        problem.score(force, spread, False)
        noisy = math.exp(2 * u.noise) / spread
        weight, gradient = problem.weight, problem.gradient
        q, records, size = len(columns), course.records, len(self.vector)
        cuts = course.starts[:-1]
        information = np.zeros((size, size))
        weighted = columns * weight[0]
        coupled = weight[1] * noisy  # rounding couples the noise with the force
        information[:q, :q] = weighted @ columns.T
        information[:q, -1] = columns @ coupled
        places = q + np.arange(OWN * records).reshape(OWN, records)
        for k in range(OWN):
            information[:q, places[k]] = np.add.reduceat(weighted * own[k], cuts, axis=1)
            information[places[k], -1] = np.add.reduceat(coupled * own[k], cuts)
            for other in range(k, OWN):
                both = np.add.reduceat(weight[0] * own[k] * own[other], cuts)
                information[places[k], places[other]] = both
        information[-1, -1] = float(weight[2] @ noisy**2)
        information = np.triu(information) + np.triu(information, 1).T
        information[np.diag_indices(size)] += self.prior_std**-2
        slope = self.pull(columns, own, gradient[0])
        slope[-1] = float(gradient[1] @ noisy)
        slope -= (self.vector - self.centre) / self.prior_std**2
        gaps = problem.stribeck_gaps(u.coordinates)
        for peak, gap in zip(problem.peaked, gaps, strict=True):
            if gap > 0:
                at = np.array(peak)
                information[np.ix_(at, at)] += np.array([[1, -1], [-1, 1]]) / UNDER**2
                slope[at] -= np.array([gap, -gap]) / UNDER**2
        return Pieces(information, slope, columns, own, noisy)

    def pull(self, columns: Matrix, own: Matrix, weighted: Vector) -> Vector:
        """Derivatives of the prediction times a weighted residual, for all unknowns."""
        each = [np.add.reduceat(weighted * row, self.problem.course.starts[:-1]) for row in own]
        return np.concatenate([columns @ weighted, *each, [0.0]])

    def run(self, iterations: int) -> float:
        """Maximize the likelihood; return the final cost."""
        damping, cost = 1e-3, self.cost(self.vector)
        free = np.setdiff1d(np.arange(len(self.vector)), self.held)
        for _ in range(iterations):
            pieces = self.normal()
            gained = 0.0
            for _ in range(8):
                matrix = pieces.information[np.ix_(free, free)].copy()
                matrix[np.diag_indices_from(matrix)] *= 1 + damping
                step = np.zeros(len(self.vector))
                step[free] = np.linalg.solve(matrix, pieces.slope[free])
                logarithms = np.append(step[: self.problem.logarithms], step[-1])
                far = float(np.max(np.abs(logarithms)))
                if far > _LONGEST_MOVE:
                    step *= _LONGEST_MOVE / far
                tried = self.cost(self.vector + step)
                if math.isfinite(tried) and tried < cost:
                    gained, cost = cost - tried, tried
                    self.vector = self.vector + step
                    damping = max(damping / 5, 1e-9)
                    break
                damping *= 6
            if gained < 1e-4:
                break
        return cost
