"""The likelihood of a law along records, and its expected information."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from .fitted_law import FittedLaw
from .law_along_record import LawValues, friction_along, score
from .layout import AROUND, StackedRecords, break_aways

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

# Share of the largest force: samples with a larger change in a sampling interval have little
# weight, because the motion within the interval is not known, and its error is the same in all
# records.
_SUDDEN = 0.05
_BEFORE = 30  # samples in which a filter forgets its start
_NOTHING = 1e3  # standard deviation of a sample for which the law gives no force [N]
_UNSEEN = 0.3  # error by unknown motion between samples, over the change of force per sample


class Problem:
    """Prediction, likelihood and information of a law on a course."""

    def __init__(self, course: StackedRecords, law: FittedLaw, tied: bool) -> None:
        self.course, self.law, self.tied = course, law, tied
        self.of_law = len(law.parameters) * (1 if tied else 2)
        self.size = self.of_law + len(law.beside)
        self.logarithms = self.of_law + law.mass
        # coordinates of Fc and Fs: Fs is never less than Fc
        self.peaked: list[tuple[int, int]] = []
        if {"Fc", "Fs"} <= set(law.parameters):
            fc, fs = (law.parameters.index(n) for n in ("Fc", "Fs"))
            firsts = range(0, self.of_law, len(law.parameters))
            self.peaked = [(first + fc, first + fs) for first in firsts]
        self.owner = course.of_record()
        rigid = law.rigid
        self.spoken = ~course.still if rigid else np.ones(len(course.x), dtype=bool)
        self.break_aways = break_aways(course) if rigid else {}
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

    def along(
        self,
        coordinates: Vector,
        shifts: Vector,
        gains: Matrix,
        vibration: Vector,
        motion: Matrix | None = None,
    ) -> Vector:
        """Force along the records, or another motion, before the delay, shape (n,) [N]."""
        course = self.course
        place, speed, inertial = (course.x, course.v, course.inertial) if motion is None else motion
        way = place - self.begin
        gain, bend = gains[0][self.owner], gains[1][self.owner] * self.per_way
        x = self.begin + way * (1 + gain + bend * way)
        v = speed * (1 + gain + 2 * bend * way)
        values = self.law.values_at(coordinates)
        half = len(self.law.parameters)
        forwards, backwards = values[:half], values[self.of_law - half : self.of_law]
        constant = float(values[-1]) if self.law.offset else 0.0
        if self.law.mass:
            inertial = inertial * (values[self.of_law] / course.mass)
        law = LawValues(self.law.name, forwards, backwards)
        friction = friction_along(law, x, v, course.step, course.starts, shifts, vibration)
        friction += constant
        if self.law.rigid:
            where = ~self.spoken
            friction[where] = course.force[where] - inertial[where]
            static = half - 2  # Fs, before Vs
            for k, sign in self.break_aways.items():
                held = sign * (forwards if sign > 0 else backwards)[static]
                friction[k] = held + constant
        return friction + inertial

    def later(self, force: Vector, delays: Vector) -> Vector:
        """The force delayed by `delays`, by a filter that keeps the size of all frequencies.

        Interpolation reduces the noise of the acceleration: the fit would then prefer a delay of
        half a sample. Before and after a record its slope goes on.
        """
        late = force.copy()
        for r in np.flatnonzero(delays[self.course.clock]):
            samples = float(delays[self.course.clock[r]] / self.course.step[r])
            part = slice(self.course.starts[r], self.course.starts[r + 1])
            own = force[part][:: 1 if samples > 0 else -1]
            c = -abs(samples) / (2 + abs(samples))  # Thiran's, for one sample more
            before = 2 * own[0] - own[_BEFORE:0:-1]
            longer = np.concatenate([before, own, [2 * own[-1] - own[-2]]])
            moved, _ = lfilter([c, 1], [1, c], longer, zi=[(1 - c) * longer[0]])
            late[part] = moved[len(before) + 1 :][:: 1 if samples > 0 else -1]
        return late

    def unseen(self, force: Vector) -> Vector:
        """Variance of a sample due to unknown motion between samples, shape (n,) [N^2]."""
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
            near = course.force[k - AROUND : k + AROUND + 1]
            variance[k] = float(np.max(np.abs(np.diff(near)))) ** 2
        return variance

    def stribeck_gaps(self, coordinates: Vector) -> list[float]:
        """ln Fc less ln Fs by direction; the law requires a negative value."""
        return [float(coordinates[fc] - coordinates[fs]) for fc, fs in self.peaked]

    def cost(self, predicted: Vector, spread: Vector) -> float:
        """Minus the log-likelihood."""
        return self._score(predicted, spread, True)

    def weigh(self, predicted: Vector, spread: Vector) -> None:
        """Store the gradient and the expected information of each sample."""
        self._score(predicted, spread, False)

    def _score(self, predicted: Vector, spread: Vector, cost_only: bool) -> float:
        course = self.course
        return score(
            course.force,
            predicted,
            spread,
            course.resolution,
            self.gradient,
            self.weight,
            cost_only,
        )
