"""Rows of a long run for a picture: as many as it can show, with every peak among them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

COLUMNS = 2000  # of a picture: more than twice as many as it has pixels across


def rows_over_time(time: Vector, values: Vector, columns: int = COLUMNS) -> Rows:
    """Rows of a curve (n,) to draw, in order: the first, last, smallest and largest of each column.

    At most four for each column, and all if there are not more.
    """
    if len(time) <= 4 * columns:
        return np.arange(len(time))
    edges = np.linspace(time[0], time[-1], columns + 1)[1:-1]
    begins = np.unique([0, *np.searchsorted(time, edges), len(time)])
    kept = [
        row
        for begin, end in pairwise(begins)
        for row in (
            begin,
            begin + int(np.argmin(values[begin:end])),
            begin + int(np.argmax(values[begin:end])),
            end - 1,
        )
    ]
    return np.unique(kept)


def rows_over_plane(points: npt.NDArray[np.float64], cells: int = COLUMNS) -> Rows:
    """Rows of a curve (n, 2) to draw: where it enters and leaves cells, and its extremes.

    They are in order; omitted rows are within a cell of the returned ones.
    """
    if len(points) <= 2:
        return np.arange(len(points))
    low = points.min(axis=0)
    span = np.maximum(points.max(axis=0) - low, np.finfo(float).tiny)
    cell = ((points - low) / span * cells).astype(np.int64)
    moved = np.any(cell[1:] != cell[:-1], axis=1)
    kept = np.zeros(len(points), dtype=bool)
    kept[1:] |= moved
    kept[:-1] |= moved
    kept[[0, -1, *points.argmin(axis=0), *points.argmax(axis=0)]] = True
    return np.flatnonzero(kept)
