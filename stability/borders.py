"""Borders between the verdicts of a map: cells at a border, and its position."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .attractor import Kind
from .chunk import cells_of
from .map_plan import MapPlan

if TYPE_CHECKING:
    from ..orchestration.workers import Workers


Progress = Callable[[int, int], None]
HALVINGS = 8  # of a border's width


def border_cells(verdicts: npt.NDArray[np.int8]) -> npt.NDArray[np.int64]:
    """Flat indices of the cells that have a neighbour of another verdict."""
    edge = np.zeros(verdicts.shape, dtype=bool)
    across, along = verdicts[:, 1:] != verdicts[:, :-1], verdicts[1:] != verdicts[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= along
    edge[:-1] |= along
    return np.flatnonzero(edge)


def run_border(plan: MapPlan, task: tuple[bool, float, float, float, str, str]) -> dict[str, Any]:
    """Halve the distance between two cells of different verdict until it is small."""
    along_x, fixed, low, high, below, above = task
    with cells_of(plan, 1.0) as cell_at:
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            point = (middle, fixed) if along_x else (fixed, middle)
            found = cell_at(*point).verdict.value
            if found == below:
                low = middle
            else:
                high, above = middle, found
    position = 0.5 * (low + high)
    return {
        plan.x.name: position if along_x else fixed,
        plan.y.name: fixed if along_x else position,
        "along": plan.x.name if along_x else plan.y.name,
        "width": high - low,
        "below": below,
        "above": above,
    }


def _border_tasks(plan: MapPlan, verdicts: npt.NDArray[np.int8]) -> Iterator[tuple[str, Any]]:
    kinds = [k.value for k in Kind]
    grid = verdicts.reshape(plan.y.count, plan.x.count)
    xs, ys = plan.x.values(), plan.y.values()
    for j, i in zip(*np.nonzero(grid[:, 1:] != grid[:, :-1]), strict=True):
        names = kinds[grid[j, i]], kinds[grid[j, i + 1]]
        yield f"x{j}-{i}", (plan, (True, float(ys[j]), float(xs[i]), float(xs[i + 1]), *names))
    for j, i in zip(*np.nonzero(grid[1:] != grid[:-1]), strict=True):
        names = kinds[grid[j, i]], kinds[grid[j + 1, i]]
        yield f"y{j}-{i}", (plan, (False, float(xs[i]), float(ys[j]), float(ys[j + 1]), *names))


def refined_borders(
    plan: MapPlan,
    verdicts: npt.NDArray[np.int8],
    workers: Workers,
    progress: Progress | None,
) -> tuple[str, int]:
    """The table of borders as text, and their number."""
    tasks = list(_border_tasks(plan, verdicts))
    rows = {}
    for name, row in workers.map(run_border, iter(tasks)):
        rows[name] = row
        if progress:
            progress(len(rows), len(tasks))
    header = [plan.x.name, plan.y.name, "along", "width", "below", "above"]
    lines = [",".join(header)]
    for name, _ in tasks:
        row = rows[name]
        lines.append(
            ",".join(f"{row[c]:.12g}" if isinstance(row[c], float) else row[c] for c in header)
        )
    return "\n".join(lines) + "\n", len(tasks)
