"""What the controller is asked to follow: a constant, or a recorded course."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..fmus.set_point import DERIVATIVES, SET_POINT

Vector = npt.NDArray[np.float64]
_COLUMNS = (SET_POINT, *DERIVATIVES)


class BadReference(ValueError):
    """The reference file cannot be used; the message says where and why."""


@dataclass(frozen=True)
class Reference:
    """Set-point over time: linear between the given points, held outside of them.

    Attributes
    ----------
    times, values : ndarray, shape (m,)
        [s], [m]; one point is a constant. Of two points at one time, a step, the later holds.
    velocity, acceleration : ndarray, shape (m,), optional
        Derivatives at the points, for feed-forward [m/s], [m/s^2]. Default: central differences,
        exact for a parabola.
    """

    times: Vector
    values: Vector
    velocity: Vector | None = None
    acceleration: Vector | None = None

    @classmethod
    def constant(cls, value: float) -> Reference:
        return cls(np.array([0.0]), np.array([float(value)]))

    @classmethod
    def read(cls, path: Path | str) -> Reference:
        """Read a CSV file with the columns ``time`` [s] and ``x_d`` [m].

        ``v_d`` [m/s] and ``a_d`` [m/s^2] are taken from it, too, where it has them.

        Raises
        ------
        BadReference
            If the file is missing or is not such a table.
        """
        try:
            with open(path, newline="", encoding="utf-8-sig") as stream:
                rows = list(csv.reader(stream))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise BadReference(f"{path}: cannot be read: {error}") from error
        header = [name.strip() for name in rows[0]] if rows else []
        if "time" not in header or "x_d" not in header:
            raise BadReference(
                f"{path}: has the columns {', '.join(header) or 'none'}, expected time and x_d"
            )
        names = ["time", *(n for n in _COLUMNS if n in header)]
        for name in names:
            if header.count(name) > 1:
                raise BadReference(f"{path}: the column {name!r} is there twice, expected once")
        columns = [header.index(name) for name in names]
        points = []
        for number, row in enumerate(rows[1:], start=2):
            if not any(cell.strip() for cell in row):
                continue
            try:
                points.append([float(row[c]) for c in columns])
            except (ValueError, IndexError) as error:
                what = "no pair of numbers" if len(names) == 2 else f"not {len(names)} numbers"
                raise BadReference(f"{path}: line {number} is {what}") from error
        table = np.array(points, dtype=float).reshape(-1, len(names))
        if not len(table):
            raise BadReference(f"{path}: has a header and no rows")
        if not np.isfinite(table).all():
            raise BadReference(f"{path}: holds values that are not finite")
        if np.any(np.diff(table[:, 0]) <= 0):
            k = int(np.argmax(np.diff(table[:, 0]) <= 0))
            raise BadReference(f"{path}: time does not rise after {table[k, 0]:g} s")
        given = dict(zip(names, table.T, strict=True))
        return cls(given["time"], *(given.get(name) for name in _COLUMNS))  # type: ignore[arg-type]

    @property
    def is_constant(self) -> bool:
        return bool(np.all(self.values == self.values[0]))

    def at(self, t: float) -> float:
        return float(self.all_at(t, (0,))[0])

    def all_at(self, t: float, orders: Sequence[int]) -> Vector:
        """The set-point's derivatives of these orders (0: itself) at a time [s], shape (n,)."""
        return np.array([self.on(np.array([t]), order)[0] for order in orders])

    def on(self, grid: Vector, order: int) -> Vector:
        """The set-point (order 0) or a derivative at times [s] of any order, shape (m,)."""
        values = self.derivative(order)
        after = np.searchsorted(self.times, grid, side="right")  # the first point after each
        here, last = np.maximum(after - 1, 0), len(values) - 1
        inside = (after > 0) & (after <= last)
        following = np.where(inside, after, here)
        span = np.where(inside, self.times[following] - self.times[here], 1.0)
        slope = (values[following] - values[here]) / span
        return np.asarray(slope * (grid - self.times[here]) * inside + values[here])

    def derivative(self, order: int) -> Vector:
        """Values at the points of the set-point (order 0) or of a derivative, shape (m,).

        Raises
        ------
        BadReference
            If a derivative is not given, and has no differences where the set-point steps.
        """
        values = (self.values, self.velocity, self.acceleration)[order]
        if values is not None:
            return np.asarray(values, dtype=float)
        if len(self.times) < 3 or self.is_constant:
            slope = np.diff(self.values) / np.diff(self.times) if len(self.times) == 2 else 0.0
            return np.full(len(self.times), slope if order == 1 else 0.0)
        if not np.all(np.diff(self.times) > 0):
            raise BadReference("a set-point with steps has no differences; give its velocity")
        return np.asarray(np.gradient(self.derivative(order - 1), self.times, edge_order=2))
