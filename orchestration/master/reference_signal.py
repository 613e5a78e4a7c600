"""Set-point of the controller: a constant, a table, or a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...measurement.records.table import listed, read_tables, rename
from ...measurement.records.units import NO_UNIT, UNITS, quantity_of, spell
from ...solver.arrays import Matrix, Vector
from ...solver.errors import BadParameter, BadRecord
from ...solver.signals import DERIVATIVES, SET_POINT

TERMS = 8  # coefficients of each piece: a sine is exact to round-off within a twentieth of a radian
ROUND_OFF = 1e-9  # of a step: times closer to each other are equal

_QUANTITIES = {  # of the columns of a file
    "time": ("time",),
    SET_POINT: ("length", "angle"),
    "v_d": ("velocity", "angular velocity"),
    "a_d": ("acceleration", "angular acceleration"),
}


@dataclass(frozen=True)
class Reference:
    """Set-point as a function of time, which may jump; held outside of its points.

    Attributes
    ----------
    times, values : ndarray, shape (m,)
        [s], [m]; one point is a constant. Two points at one time are a jump: the first is the limit
        from before, the second holds from then on.
    velocity, acceleration : ndarray, shape (m,), optional
        Derivatives at the points, for feed-forward [m/s], [m/s^2]. Default: central differences
        between jumps, exact for a parabola.
    curve : ndarray, shape (m, TERMS), optional
        From each point on, the coefficients of a polynomial in the time since it, which holds until
        the next; the derivatives are then its own. Default: all is linear between points.
    measure : str
        ``length`` or ``angle``, if the file that it is read from says so.
    """

    times: Vector
    values: Vector
    velocity: Vector | None = None
    acceleration: Vector | None = None
    curve: Matrix | None = None
    measure: str = ""
    _pieces: dict[int, Matrix] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def constant(cls, value: float) -> Reference:
        return cls(np.array([0.0]), np.array([float(value)]))

    @classmethod
    def of_pieces(cls, times: npt.ArrayLike, curve: npt.ArrayLike) -> Reference:
        """From polynomials in the time since each point; the last value is held."""
        given = np.asarray(curve, dtype=float)
        padded = np.zeros((len(given), TERMS))
        padded[:, : given.shape[1]] = given
        padded[-1, 1:] = 0.0
        return cls(np.asarray(times, dtype=float), padded[:, 0].copy(), curve=padded)

    @classmethod
    def read(cls, path: Path | str) -> Reference:
        """Read a table with the columns ``time`` [s] and ``x_d`` [m], in any format of records.

        ``v_d`` [m/s] and ``a_d`` [m/s^2] are also read if it has them. Units that the file gives
        are converted.

        Raises
        ------
        BadParameter
            If the file is missing or is not such a table.
        """
        try:
            tables = read_tables(Path(path))
            fit = [t for t in tables if {"time", SET_POINT} <= t.columns.keys() | t.faults.keys()]
            if len(fit) != 1:
                there = "; ".join(listed(t.columns) for t in fit or tables)
                expected = "expected one table with time and x_d"
                raise BadParameter(f"{path}: has the columns {there}, {expected}")
            table = rename(fit[0], {}, list(_QUANTITIES), ())
        except BadRecord as error:
            raise BadParameter(str(error)) from error
        given = {n: c * _size(path, n, table.units.get(n, "")) for n, c in table.columns.items()}
        time = given.pop("time")
        if not np.isfinite([time, *given.values()]).all():
            raise BadParameter(f"{path}: contains values that are not finite")
        rises = np.diff(time)
        wrong = rises < 0
        wrong[1:] |= (rises[1:] == 0) & (rises[:-1] == 0)  # two rows at one time are a jump
        if wrong.any():
            before = time[np.argmax(wrong)]
            raise BadParameter(f"{path}: time does not increase after {before:g} s")
        velocity, acceleration = (given.get(name) for name in DERIVATIVES)
        measure = quantity_of(table.units.get(SET_POINT, ""))
        return cls(time, given[SET_POINT], velocity, acceleration, measure=measure)

    def check_measure(self, unit: str) -> None:
        """Raise `BadParameter` if a plant whose position has this unit cannot follow it."""
        expected = quantity_of(unit)
        if self.measure and expected in _QUANTITIES[SET_POINT] and self.measure != expected:
            raise BadParameter(
                f"the set-point's file has x_d as {self.measure}, and the plant's position is in "
                f"{unit!r}; give x_d as {expected}"
            )

    def notes(self, stop: float) -> tuple[str, ...]:
        """A note if it does not move until a time [s]."""
        if len(self.times) == 1 or self.times[0] < stop:
            return ()
        first = f"its first point is at {self.times[0]:g} s"
        return (f"the set-point does not change within this run of {stop:g} s: {first}",)

    def all_at(self, t: float, orders: Sequence[int]) -> Vector:
        """The set-point's derivatives of these orders (0: itself) at a time [s], shape (n,)."""
        return np.array([self.on(np.array([t]), order)[0] for order in orders])

    def on(self, grid: Vector, order: int, before: bool = False) -> Vector:
        """The set-point (order 0) or a derivative at times [s] of any order, shape (m,).

        Parameters
        ----------
        before : bool
            At a jump: whether to return the limit from before, or the value from then on.
        """
        index = np.searchsorted(self.times, grid, side="left" if before else "right")
        since = grid - self.times[np.maximum(index - 1, 0)]
        found = np.zeros(len(grid))
        pieces = self.pieces(order)
        for term in reversed(range(TERMS)):
            found = found * since + pieces[index, term]
        return found

    def derivative(self, order: int) -> Vector:
        """Values at the points of the set-point (order 0) or of a derivative, shape (m,)."""
        given = (self.values, self.velocity, self.acceleration)[order]
        if given is not None:
            return np.asarray(given, dtype=float)
        if self.curve is not None:
            return self.pieces(order)[1:, 0]
        before = self.derivative(order - 1)
        jumps = np.flatnonzero(np.diff(self.times) == 0) + 1
        parts = zip(np.split(self.times, jumps), np.split(before, jumps), strict=True)
        return np.concatenate([_differences(t, x) for t, x in parts])

    def pieces(self, order: int) -> Matrix:
        """The set-point or a derivative as polynomials in the time since each point.

        Returns
        -------
        ndarray, shape (m + 1, TERMS)
            Coefficients, the constant ones first; row 0 holds before the first point.
        """
        if order in self._pieces:
            return self._pieces[order]
        self._pieces[order] = rows = np.zeros((len(self.times) + 1, TERMS))
        if self.curve is not None:
            own = self.curve
            for _ in range(order):
                own = np.pad(own[:, 1:] * np.arange(1, TERMS), ((0, 0), (0, 1)))
            rows[1:] = own
        else:
            rows[1:, 0] = values = self.derivative(order)
            rise = np.diff(self.times)
            np.divide(np.diff(values), rise, out=rows[1:-1, 1], where=rise > 0)
        if order:
            rows[-1] = 0.0  # a held value does not move
        else:
            rows[0, 0] = rows[1, 0]
        return rows

    def jumps(self, orders: Sequence[int]) -> Vector:
        """Times at which the set-point or one of these derivatives jumps, shape (k,) [s]."""
        times = np.unique(self.times)
        found = np.zeros(len(times), dtype=bool)
        for order in orders:
            size = np.abs(self.on(times, order) - self.on(times, order, before=True))
            found |= size > self._least(order)
        return times[found]

    def _least(self, order: int) -> float:
        """The largest difference of two values that is round-off."""
        return float(ROUND_OFF * np.abs(self.pieces(order)[:, 0]).max())

    def bends_within(self, step: float, stop: float, orders: Sequence[int], breaks: Vector) -> bool:
        """Whether it, or one of these derivatives, is not straight within the steps of a run.

        Steps end at multiples of `step`, until `stop`, and at the times `breaks` [s].
        """
        here = self.times < stop
        times = self.times[here]
        met = np.abs(times - np.round(times / step) * step) <= ROUND_OFF * step
        within = ~met & ~np.isin(times, breaks)
        reach = np.minimum(np.diff(self.times, append=np.inf)[here], step)
        for order in orders:
            before, after = self.pieces(order)[:-1][here], self.pieces(order)[1:][here]
            bent = after[:, 2:] * reach[:, None] ** np.arange(2, TERMS)
            # difference in value and in slope of the pieces that meet at each point
            apart = (_moved(before, np.diff(times, prepend=times[:1])) - after)[within, :2]
            sizes = np.abs(bent).ravel(), np.abs(apart * [1.0, step]).ravel()
            if (np.concatenate(sizes) > self._least(order)).any():
                return True
        return False

    def between(self, grid: Vector, orders: Sequence[int]) -> tuple[Vector, list[Matrix]]:
        """A grid with all points of the set-point in it, and the polynomials from each time on.

        A point within round-off of one of the grid's rising times [s] is moved to it. Returns the
        times, shape (k,) [s], and for each order the coefficients in the time since each of these,
        shape (k, TERMS), which hold until the next.
        """
        close = ROUND_OFF * float(np.diff(grid).min(initial=np.inf))
        points = self.times[(self.times > grid[0] + close) & (self.times < grid[-1] - close)]
        nearest = np.searchsorted(grid, points)
        points = points[np.minimum(points - grid[nearest - 1], grid[nearest] - points) > close]
        points = points[np.diff(points, prepend=-np.inf) > close]
        times = np.sort(np.concatenate([grid, points]))
        middle = np.append(0.5 * (times[:-1] + times[1:]), times[-1] + close)
        index = np.searchsorted(self.times, middle, side="right")
        since = times - self.times[np.maximum(index - 1, 0)]
        return times, [_moved(self.pieces(order)[index], since) for order in orders]


def _size(path: Path | str, name: str, unit: str) -> float:
    """Factor of a column to SI."""
    if unit in NO_UNIT:
        return 1.0
    if (quantity := quantity_of(unit)) in _QUANTITIES[name]:
        return UNITS[quantity][spell(unit)]
    known = ", ".join(u for q in _QUANTITIES[name] for u in UNITS[q])
    raise BadParameter(f"{path}: {name} is in {unit!r}, expected one of {known}")


def _differences(times: Vector, values: Vector) -> Vector:
    """Slopes at points between two jumps."""
    if len(times) < 3:
        return np.full(len(times), np.diff(values)[0] / np.diff(times)[0] if len(times) == 2 else 0)
    return np.asarray(np.gradient(values, times, edge_order=2))


def _moved(rows: Matrix, since: Vector) -> Matrix:
    """Polynomials in the time since a later point, by Horner's scheme of repeated division."""
    rows = rows.copy()
    terms = np.flatnonzero(rows.any(axis=0))
    last = int(terms[-1]) if len(terms) else 0
    for first in range(last):
        for term in range(last - 1, first - 1, -1):
            rows[:, term] += since * rows[:, term + 1]
    return rows
