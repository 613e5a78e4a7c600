"""The most likely parameters: Fisher scoring with Marquardt's damping from a first guess."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .likelihood import Problem

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

OWN = 4  # unknowns of each single record: displacement, two of scale, vibration
_WIDE = 3.0  # prior standard deviation of the logarithm of an unknown parameter
_WIDE_OFFSET = 10.0  # prior standard deviation of an unknown constant force, over the largest force
_CERTAIN = 1e-9  # prior standard deviation of a fixed parameter
_VIBRATION = 5e-7  # prior spread of a vibration below the sensors' noise [m/s]: 0.05 um at some Hz
UNDER = 0.01  # share by which a fitted Fs may be below Fc
_LONGEST_TOGETHER = 100.0  # largest number of samples with the same position error
_STEP = 1e-4  # of finite differences, in logarithms
_LONGEST_MOVE = 0.7  # longest step of one iteration, in logarithms


@dataclass
class Point:
    """All unknowns.

    These are the law's coordinates, the delays, and the logarithm of the noise; and for each record
    the displacement before its first sample, the errors of scale, linear and quadratic over its
    travel, and the vibration.
    """

    coordinates: Vector
    delays: Vector
    shifts: Vector
    gains: Matrix
    vibration: Vector
    noise: float

    def moved(self, step: Vector) -> Point:
        cuts = np.cumsum([len(self.coordinates), len(self.delays), len(self.shifts)])
        coordinates, delays, shifts, rest = np.split(step, cuts)
        linear, quadratic, vibration = rest[:-1].reshape(3, -1)
        return Point(
            self.coordinates + coordinates,
            self.delays + delays,
            self.shifts + shifts,
            self.gains + np.stack([linear, quadratic]),
            self.vibration + vibration,
            self.noise + float(rest[-1]),
        )


@dataclass(frozen=True)
class Pieces:
    """Quantities for one step of the maximization.

    Attributes
    ----------
    information : ndarray, shape (unknowns, unknowns)
    slope : ndarray, shape (unknowns,)
    columns : ndarray, shape (p + clocks, n)
        Derivatives of the force.
    own : ndarray, shape (OWN, n)
        Derivatives of the force by the unknowns of the sample's record: displacement before, errors
        of scale, vibration.
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
        wide[problem.logarithms :] = _WIDE_OFFSET * course.level
        wide[list(held)] = _CERTAIN
        self.prior_std = np.concatenate(
            [
                wide,
                problem.clock_std,
                course.shift_std,
                course.gain_std,
                0.5 * course.gain_std,
                np.full(course.records, _VIBRATION),
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
                point.vibration,
                [point.noise],
            ]
        )

    def spread(self, point: Point) -> Vector:
        """Standard deviation of each sample before rounding [N]."""
        least = max(0.1 * self.problem.course.resolution, 1e-7)
        return np.sqrt(max(math.exp(point.noise), least) ** 2 + self.hidden)

    def offsets(self, point: Point) -> Vector:
        return self.vector(point) - self.centre

    def prior(self, point: Point) -> float:
        beliefs = float(np.sum((self.offsets(point) / self.prior_std) ** 2))
        under = (max(gap, 0.0) for gap in self.problem.stribeck_gaps(point.coordinates))
        return 0.5 * (beliefs + sum((gap / UNDER) ** 2 for gap in under))

    def force(self, point: Point) -> Vector:
        problem = self.problem
        before = problem.along(point.coordinates, point.shifts, point.gains, point.vibration)
        return problem.later(before, point.delays)

    def force_on(self, motion: Matrix) -> Vector:
        """Force along another motion, with the present parameters, shape (n,) [N]."""
        u = self.point
        force = self.problem.along(u.coordinates, u.shifts, u.gains, u.vibration, motion)
        return self.problem.later(force, u.delays)

    def look_back(self) -> None:
        """Compute force errors by the reconstruction of the motion, with the present parameters."""
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
        base = problem.along(point.coordinates, point.shifts, point.gains, point.vibration)
        here = problem.later(base, point.delays)
        columns = np.empty((p + course.clocks, len(base)))
        for j in range(p):
            moved = point.coordinates.copy()
            moved[j] += _STEP
            force = problem.along(moved, point.shifts, point.gains, point.vibration)
            columns[j] = (problem.later(force, point.delays) - here) / _STEP
        for c in range(course.clocks):
            moved = point.delays.copy()
            tiny = 1e-3 * problem.clock_std[c]
            moved[c] += tiny
            columns[p + c] = (problem.later(base, moved) - here) / tiny
        own = np.empty((OWN, len(base)))
        force = problem.along(point.coordinates, point.shifts + 1e-9, point.gains, point.vibration)
        own[0] = (problem.later(force, point.delays) - here) / 1e-9
        for k in range(2):
            bent = point.gains.copy()
            bent[k] += 1e-5
            force = problem.along(point.coordinates, point.shifts, bent, point.vibration)
            own[1 + k] = (problem.later(force, point.delays) - here) / 1e-5
        tiny = 1e-3 * _VIBRATION
        force = problem.along(point.coordinates, point.shifts, point.gains, point.vibration + tiny)
        own[3] = (problem.later(force, point.delays) - here) / tiny
        return columns, own

    def normal(self, point: Point) -> Pieces:
        """Information and gradient of all unknowns, with priors, and the quantities for them."""
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
        information[everything, everything] += self.prior_std**-2
        slope -= self.offsets(point) / self.prior_std**2
        gaps = problem.stribeck_gaps(point.coordinates)
        for (fc, fs), gap in zip(problem.peaked, gaps, strict=True):
            if gap > 0:
                at = np.array([fc, fs])
                information[np.ix_(at, at)] += np.array([[1, -1], [-1, 1]]) / UNDER**2
                slope[at] -= np.array([gap, -gap]) / UNDER**2
        return Pieces(information, slope, columns, own, noisy)

    def pull(self, pieces: Pieces, weighted: Vector) -> Vector:
        """Derivatives of the prediction times a weighted residual, for all unknowns."""
        cuts = self.problem.course.starts[:-1]
        own = [np.add.reduceat(weighted * row, cuts) for row in pieces.own]
        return np.concatenate([pieces.columns @ weighted, *own, [0.0]])

    def run(self, iterations: int) -> float:
        """Maximize the likelihood; return the final cost."""
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
                logarithms = np.append(step[: self.problem.logarithms], step[-1])
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
