"""The likelihood of a law along records, and the search for its largest value.

The search is Fisher scoring with Marquardt's damping from a first guess. All unknowns are one
vector: the law's coordinates with mass and offset; a delay [s] for each sampling interval; then for
each record the displacement before its first sample [m], the errors of scale, linear and quadratic
over its travel, and its vibration [m/s]; the logarithm of the noise [N].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Matrix, Vector
from ...solver.kernel import DEFAULT_TOLERANCE
from .fitted_law import FittedLaw
from .law_along_record import LawValues, delayed, friction_along, score
from .layout import StackedRecords, break_aways

OWN = 4  # unknowns of each single record: displacement, two of scale, vibration
UNDER = 0.01  # share by which a fitted Fs may be below Fc
_STEP = math.sqrt(DEFAULT_TOLERANCE)  # of finite differences of a solved law, in logarithms
_LONGEST_MOVE = math.log(2)  # of one iteration: nothing more than doubles
# prior standard deviation of the logarithm of an unknown parameter, and of an unknown constant
# force over the largest force
_WIDE = 3.0
_VIBRATION = 5e-7  # that of a vibration below the sensors' noise [m/s]: 0.05 um at some Hz
_CERTAIN = math.sqrt(np.finfo(float).eps)  # that of a fixed parameter


class Problem:
    """Prediction and likelihood of a law on a course, by the vector of unknowns."""

    def __init__(self, course: StackedRecords, law: FittedLaw) -> None:
        self.course, self.law = course, law
        self.of_law = len(law.names)
        self.size = self.of_law + len(law.beside)
        self.shared = self.size + course.clocks  # parameters and delays
        self.logarithms = self.of_law + law.mass
        # ln Fc less ln Fs by direction, of the coordinates; the law requires a negative value
        self.gaps = np.zeros((len(law.ends), self.size))
        for row, end in zip(self.gaps, law.ends, strict=True):
            if {"Fc", "Fs"} <= set(law.parameters):
                row[[law.names.index(n + end) for n in ("Fc", "Fs")]] = 1.0, -1.0
        self.spoken = course.recorded & ~(law.rigid & course.still)
        self.break_aways = break_aways(course) if law.rigid else {}
        self.peaks = np.array(list(self.break_aways), dtype=np.int64)
        self.spoken[self.peaks] = True
        self.silent = np.flatnonzero(~self.spoken)
        self.gradient = np.empty((2, len(course.x)))
        self.weight = np.empty((3, len(course.x)))
        clocks = (course.delay_std[course.clock == c] for c in range(course.clocks))
        self.clock_std = np.array([float(np.min(std)) for std in clocks])
        self.begin = course.x[course.starts[:-1]]
        ways = np.abs(course.x - self.begin[course.owner()])
        self.reach = np.maximum(np.maximum.reduceat(ways, course.starts[:-1]), 1e-9)
        # of the last prediction along the records: what the friction depends on, and the friction
        self.kept = np.empty(0), np.empty(0)

    def before(self, vector: Vector, motion: Matrix | None = None) -> Vector:
        """Force along the records, or another motion, before the delay, shape (n,) [N]."""
        course, law = self.course, self.law
        x, v, inertial = (course.x, course.v, course.inertial) if motion is None else motion
        values = law.values_at(vector[: self.size])
        half = len(law.parameters)
        forwards, backwards = values[:half], values[self.of_law - half : self.of_law]
        constant = float(values[-1]) if law.offset else 0.0
        if law.mass:
            inertial = inertial * (values[self.of_law] / course.mass)
        moves, friction = np.append(values[: self.of_law], vector[self.shared : -1]), self.kept[1]
        if motion is not None or not np.array_equal(moves, self.kept[0]):
            shift, gain, bend, vibration = vector[self.shared : -1].reshape(OWN, -1)
            own = np.stack([shift, self.begin, gain, bend * (1.0 / self.reach), vibration])
            along = LawValues(law.name, forwards, backwards)
            friction = friction_along(along, x, v, course.step, course.starts, own)
        if motion is None:
            self.kept = moves, friction
        force = friction + constant
        if law.rigid:
            force[self.silent] = course.force[self.silent] - inertial[self.silent]
            static = half - 2  # Fs, before Vs
            for k, sign in self.break_aways.items():
                force[k] = sign * (forwards if sign > 0 else backwards)[static] + constant
        return force + inertial

    def later(self, forces: Matrix, delays: Vector) -> Matrix:
        """Forces delayed by `delays`, shape (..., n) [N]."""
        return delayed(forces, self.course.starts, (delays[self.course.clock] / self.course.step))

    def force(self, vector: Vector, motion: Matrix | None = None) -> Vector:
        """Predicted force [N], shape (n,)."""
        return self.later(self.before(vector, motion), vector[self.size : self.shared])

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
            near = course.force[k - 1 : k + 2]
            variance[k] = float(np.max(np.abs(np.diff(near)))) ** 2
        return variance

    def score(self, predicted: Vector, spread: Vector, cost_only: bool) -> float:
        """Minus the log-likelihood; stores gradient and expected information of each sample."""
        force, count = self.course.force, self.course.resolution
        return score(force, predicted, spread, count, self.gradient, self.weight, cost_only)


class Told(NamedTuple):
    """What some samples of a record tell of the unknowns at the places `at`."""

    at: npt.NDArray[np.int64]  # parameters, delays, the record's own unknowns, the noise
    local: Matrix  # derivatives of the force by all of these but the noise
    information: Matrix
    slope: Vector


class Climb:
    """The search from a first guess of the coordinates; those in `held` stay."""

    def __init__(self, problem: Problem, at: Vector, held: Sequence[int] = ()) -> None:
        course = problem.course
        self.problem, self.held = problem, list(held)
        none = np.zeros(course.clocks + OWN * course.records)
        self.centre = np.concatenate([at, none, [math.log(course.noise)]])
        self.vector = self.centre.copy()
        wide = np.full(problem.size, _WIDE)
        wide[problem.logarithms :] = _WIDE * course.level
        wide[self.held] = _CERTAIN
        gain = course.gain_std
        of_records = course.shift_std, gain, 0.5 * gain, np.full(course.records, _VIBRATION)
        self.prior_std = np.concatenate([wide, problem.clock_std, *of_records, [_WIDE]])
        self.errors = np.empty((0, len(course.x)))  # of the force, by the motion's reconstruction
        self.look_back()

    @property
    def coordinates(self) -> Vector:
        """Of the law, with mass and offset."""
        return self.vector[: self.problem.size]

    @property
    def delays(self) -> Vector:
        return self.vector[self.problem.size : self.problem.shared]

    def spread(self, noise: float) -> Vector:
        """Standard deviation of each sample before rounding [N], by the logarithm of the noise."""
        least = max(0.1 * self.problem.course.resolution, 1e-7)
        return np.sqrt(max(math.exp(noise), least) ** 2 + self.hidden)

    def look_back(self) -> None:
        """Compute force errors by the reconstruction of the motion, with the present parameters."""
        problem, course = self.problem, self.problem.course
        force = problem.force(self.vector)
        self.hidden = problem.unseen(force)
        if not len(course.replays):
            return
        again = np.array([problem.before(self.vector, motion) for motion in course.replays])
        self.errors = problem.later(again, self.delays) - force
        alone = np.mean(self.errors**2, axis=0)
        cuts = course.starts[:-1]
        together = np.mean(np.add.reduceat(self.errors, cuts, axis=1) ** 2, axis=0)
        many = together / np.maximum(np.add.reduceat(alone, cuts), 1e-30)
        self.hidden += alone * np.clip(many, 1.0, 100.0)[course.owner()]  # of one error, at most

    def cost(self, vector: Vector) -> float:
        """Minus the logarithm of likelihood and prior."""
        problem = self.problem
        likelihood = problem.score(problem.force(vector), self.spread(float(vector[-1])), True)
        beliefs = float(np.sum(((vector - self.centre) / self.prior_std) ** 2))
        under = np.maximum(problem.gaps @ vector[: problem.size], 0.0)
        return likelihood + 0.5 * (beliefs + float(np.sum((under / UNDER) ** 2)))

    def differentiate(self) -> None:
        """Prepare `told` at the present point.

        `columns` are the derivatives of the force by parameters, delays, and the own unknowns of
        the sample's record, shape (shared + OWN, n); `noisy` is that of the spread by the
        logarithm of the noise, shape (n,).
        """
        problem, vector, delays = self.problem, self.vector, self.delays
        records, p, q = problem.course.records, problem.size, problem.shared
        base = problem.before(vector)
        here = problem.later(base, delays)
        self.columns = np.zeros((q + OWN, len(base)))
        # mass and offset first, which leave the friction as it was
        moves = [(j, slice(j, j + 1), _STEP) for j in reversed(range(p))]
        effects = {0: 1e-9, 1: 1e-5, 2: 1e-5, 3: 1e-3 * _VIBRATION}
        for k in (1, 2) if problem.law.form == "dry" else effects:  # it has no deflection
            moves.append((q + k, slice(q + k * records, q + (k + 1) * records), effects[k]))
        for row, where, tiny in moves:
            moved = vector.copy()
            moved[where] += tiny
            self.columns[row] = (problem.before(moved) - base) / tiny
        self.columns = problem.later(self.columns, delays)
        for c, tiny in enumerate(1e-3 * problem.clock_std):
            late = delays.copy()
            late[c] += tiny
            self.columns[p + c] = (problem.later(base, late) - here) / tiny
        spread = self.spread(float(vector[-1]))
        problem.score(here, spread, False)
        self.noisy = math.exp(2 * vector[-1]) / spread

    def of_record(self, r: int) -> npt.NDArray[np.int64]:
        """Places of the unknowns that a record depends on."""
        q, records = self.problem.shared, self.problem.course.records
        own = q + r + records * np.arange(OWN)
        return np.concatenate([np.arange(q), own, [len(self.vector) - 1]])

    def told(self, r: int, part: slice) -> Told:
        """Information and gradient by some samples of a record, after `differentiate`."""
        local, noisy = self.columns[:, part], self.noisy[part]
        weight, gradient = self.problem.weight[:, part], self.problem.gradient[:, part]
        information = np.empty((len(local) + 1, len(local) + 1))
        information[:-1, :-1] = (local * weight[0]) @ local.T
        # rounding couples the noise with the force
        information[:-1, -1] = information[-1, :-1] = local @ (weight[1] * noisy)
        information[-1, -1] = weight[2] @ noisy**2
        slope = np.append(local @ gradient[0], gradient[1] @ noisy)
        return Told(self.of_record(r), local, information, slope)

    def normal(self) -> tuple[Matrix, Vector]:
        """Information and gradient of all unknowns, with priors."""
        self.differentiate()
        information = np.diag(self.prior_std**-2)
        slope = (self.centre - self.vector) / self.prior_std**2
        for r, part in enumerate(self.problem.course.parts()):
            at, _, more, pull = self.told(r, part)
            information[np.ix_(at, at)] += more
            slope[at] += pull
        p = self.problem.size
        gaps = self.problem.gaps[self.problem.gaps @ self.coordinates > 0] / UNDER
        information[:p, :p] += gaps.T @ gaps
        slope[:p] -= gaps.T @ (gaps @ self.coordinates)
        return information, slope

    def run(self, iterations: int) -> float:
        """Maximize the likelihood; return the final cost."""
        damping, cost = 1e-3, self.cost(self.vector)
        free = np.setdiff1d(np.arange(len(self.vector)), self.held)
        for _ in range(iterations if math.isfinite(cost) else 0):
            information, slope = self.normal()
            gained = 0.0
            for _ in range(8):
                matrix = information[np.ix_(free, free)]
                matrix[np.diag_indices_from(matrix)] *= 1 + damping
                step = np.zeros(len(self.vector))
                step[free] = np.linalg.solve(matrix, slope[free])
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
