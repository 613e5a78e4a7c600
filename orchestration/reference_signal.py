"""What the controller is asked to follow: a constant, or a recorded course."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


class BadReference(ValueError):
    """The reference file cannot be used; the message says where and why."""


@dataclass(frozen=True)
class Reference:
    """Set-point over time: linear between the given points, held outside of them.

    Attributes
    ----------
    times, values : ndarray, shape (m,)
        [s], [m]; one point is a constant.
    """

    times: Vector
    values: Vector

    @classmethod
    def constant(cls, value: float) -> Reference:
        return cls(np.array([0.0]), np.array([float(value)]))

    @classmethod
    def read(cls, path: Path | str) -> Reference:
        """Read a CSV file with the columns ``time`` [s] and ``x_d`` [m].

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
        for name in ("time", "x_d"):
            if header.count(name) > 1:
                raise BadReference(f"{path}: the column {name!r} is there twice, expected once")
        columns = [header.index("time"), header.index("x_d")]
        points = []
        for number, row in enumerate(rows[1:], start=2):
            if not any(cell.strip() for cell in row):
                continue
            try:
                points.append([float(row[c]) for c in columns])
            except (ValueError, IndexError) as error:
                raise BadReference(f"{path}: line {number} is no pair of numbers") from error
        table = np.array(points, dtype=float).reshape(-1, 2)
        if not len(table):
            raise BadReference(f"{path}: has a header and no rows")
        if not np.isfinite(table).all():
            raise BadReference(f"{path}: holds values that are not finite")
        if np.any(np.diff(table[:, 0]) <= 0):
            k = int(np.argmax(np.diff(table[:, 0]) <= 0))
            raise BadReference(f"{path}: time does not rise after {table[k, 0]:g} s")
        return cls(table[:, 0], table[:, 1])

    @property
    def is_constant(self) -> bool:
        return bool(np.all(self.values == self.values[0]))

    def at(self, t: float) -> float:
        return float(np.interp(t, self.times, self.values))
