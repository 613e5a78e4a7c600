"""Set-point of the controller: a constant, a table, or a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...measurement.records.table import listed, read_tables
from ...measurement.records.units import NO_UNIT, UNITS, spell
from ...solver.errors import BadParameter, BadRecord
from ...solver.set_point import DERIVATIVES, SET_POINT

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TERMS = 8
"""Coefficients of each piece: a sine is exact to round-off within a twentieth of a radian."""
ROUND_OFF = 1e-9  # of a step: times closer to each other are equal

_COLUMNS = (SET_POINT, *DERIVATIVES)
_MEASURES = dict(
    zip(
        ("time", *_COLUMNS),
        (
            ("time",),
            ("length", "angle"),
            ("velocity", "angular velocity"),
            ("acceleration", "angular acceleration"),
        ),
        strict=True,
    )
)


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

    @classmethod
    def constant(cls, value: float) -> Reference:
        return cls(np.array([0.0]), np.array([float(value)]))

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
        except BadRecord as error:
            raise BadParameter(str(error)) from error
        wanted = {"time", SET_POINT}
        fitting = [t for t in tables if wanted <= t.columns.keys() | t.faults.keys()]
        if len(fitting) != 1:
            there = "; ".join(listed(t.columns) for t in fitting or tables)
            many = f"{len(fitting)} tables with " if fitting else ""
            raise BadParameter(
                f"{path}: has {many}the columns {there}, expected one table with time and x_d"
            )
        columns, units = fitting[0].columns, fitting[0].units
        for name in (n for n in ("time", *_COLUMNS) if n in fitting[0].faults):
            raise BadParameter(f"{path}{fitting[0].faults[name]}")
        names = ["time", *(n for n in _COLUMNS if n in columns)]
        lengths = {len(columns[n]) for n in names}
        if len(lengths) > 1:
            raise BadParameter(f"{path}: has columns of different length, expected one")
        table = np.column_stack([columns[n] * _size(path, n, units.get(n, "")) for n in names])
        if not np.isfinite(table).all():
            raise BadParameter(f"{path}: contains values that are not finite")
        rises = np.diff(table[:, 0])
        wrong = rises < 0
        wrong[1:] |= (rises[1:] == 0) & (rises[:-1] == 0)  # two rows at one time are a jump
        if wrong.any():
            k = int(np.argmax(wrong))
            raise BadParameter(f"{path}: time does not increase after {table[k, 0]:g} s")
        given = dict(zip(names, table.T, strict=True))
        found = cls(given["time"], *(given.get(name) for name in _COLUMNS))  # type: ignore[arg-type]
        return replace(found, measure=_measure(units.get(SET_POINT, "")))

    def check_measure(self, unit: str) -> None:
        """Make sure that a plant whose position has this unit can follow it.

        Raises
        ------
        BadParameter
        """
        expected = _measure(unit)
        if self.measure and expected and self.measure != expected:
            raise BadParameter(
                f"the set-point's file has x_d as {self.measure}, and the plant's position is in "
                f"{unit!r}; give x_d as {expected}"
            )

    def notes(self, stop: float) -> tuple[str, ...]:
        """A note if it does not move until a time [s]."""
        if len(self.times) == 1 or self.times[0] < stop:
            return ()
        return (
            f"the set-point does not change within this run of {stop:g} s: its first point is at "
            f"{self.times[0]:g} s",
        )

    @classmethod
    def of_pieces(cls, times: npt.ArrayLike, curve: npt.ArrayLike) -> Reference:
        """From polynomials in the time since each point; the last value is held."""
        given = np.asarray(curve, dtype=float)
        padded = np.zeros((len(given), TERMS))
        padded[:, : given.shape[1]] = given
        padded[-1, 1:] = 0.0
        return cls(np.asarray(times, dtype=float), padded[:, 0].copy(), curve=padded)

    def at(self, t: float) -> float:
        return float(self.all_at(t, (0,))[0])

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
        if order not in self._pieces:
            self._pieces[order] = self._made_pieces(order)
        return self._pieces[order]

    @cached_property
    def _pieces(self) -> dict[int, Matrix]:
        return {}

    def _made_pieces(self, order: int) -> Matrix:
        rows = np.zeros((len(self.times) + 1, TERMS))
        if self.curve is not None:
            powers = np.arange(1, TERMS)
            own = self.curve
            for _ in range(order):
                own = np.pad(own[:, 1:] * powers, ((0, 0), (0, 1)))
            rows[1:] = own
        else:
            values = self.derivative(order)
            rows[1:, 0] = values
            rise = np.diff(self.times)
            rows[1:-1, 1] = np.divide(
                np.diff(values), rise, out=np.zeros(len(rise)), where=rise > 0
            )
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
            found |= size > ROUND_OFF * np.abs(self.pieces(order)[:, 0]).max()
        return times[found]

    def bends_within(self, step: float, stop: float, orders: Sequence[int], breaks: Vector) -> bool:
        """Whether it, or one of these derivatives, is not straight within the steps of a run.

        Parameters
        ----------
        step, stop : float
            Steps end at multiples of `step`, until `stop` [s],
        breaks : ndarray
            and at these times [s].
        """
        here = self.times < stop
        times = self.times[here]
        met = np.abs(times - np.round(times / step) * step) <= ROUND_OFF * step
        within = ~met & ~np.isin(times, breaks)
        powers = np.arange(TERMS)
        reach = np.minimum(np.diff(self.times, append=np.inf)[here], step)[:, None] ** powers
        since = np.diff(times, prepend=times[:1])[:, None] ** powers
        for order in orders:
            before, after = self.pieces(order)[:-1][here], self.pieces(order)[1:][here]
            least = ROUND_OFF * np.abs(self.pieces(order)[:, 0]).max()
            bent = np.abs(after * reach)[:, 2:]
            jump = np.abs((before * since).sum(axis=1) - after[:, 0])
            slope = (before[:, 1:] * powers[1:] * since[:, :-1]).sum(axis=1)
            turn = np.abs(slope - after[:, 1]) * step
            if (bent > least).any() or (np.maximum(jump, turn)[within] > least).any():
                return True
        return False

    def between(self, grid: Vector, orders: Sequence[int]) -> tuple[Vector, list[Matrix]]:
        """A grid with all points of the set-point in it, and the polynomials from each time on.

        Parameters
        ----------
        grid : ndarray, shape (m,)
            Rising times [s]. A point within round-off of one of them is moved to it.
        orders : sequence of int

        Returns
        -------
        ndarray, shape (k,)
            Times [s].
        list of ndarray, shape (k, TERMS)
            For each order, coefficients in the time since each of these, which hold until the next.
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


def _measure(unit: str) -> str:
    """Whether a position's unit is one of length or angle; empty if of neither."""
    return next((m for m in _MEASURES[SET_POINT] if spell(unit) in UNITS[m]), "")


def _size(path: Path | str, name: str, unit: str) -> float:
    """Factor of a column to SI."""
    if unit in NO_UNIT:
        return 1.0
    known = {u: f for quantity in _MEASURES[name] for u, f in UNITS[quantity].items()}
    if spell(unit) not in known:
        raise BadParameter(f"{path}: {name} is in {unit!r}, expected one of {', '.join(known)}")
    return known[spell(unit)]


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
