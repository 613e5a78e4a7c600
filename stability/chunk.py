"""Cells of a map, one after another, with their common parts made once."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence

from .cell import Cell, run_cell
from .fmu_cell import run_fmu_cell
from .fmu_parts import opened_parts
from .map_plan import MapPlan, kernel_of
from .store import Columns


@contextlib.contextmanager
def cells_of(plan: MapPlan, share: float) -> Iterator[Callable[[float, float], Cell]]:
    """A function that runs the cell at a point; common parts of the cells are made once.

    Parameters
    ----------
    plan : MapPlan
    share : float
        Factor on its tolerance, or on its step over FMUs.
    """
    if plan.fmus is None:
        system = kernel_of(plan).system()
        yield lambda x, y: run_cell(plan, x, y, share * plan.tolerance, system)
        return
    fmus = plan.fmus
    with opened_parts(plan.loop, fmus.tangents) as parts:
        yield lambda x, y: run_fmu_cell(plan, fmus, parts, x, y, share)


def run_chunk(plan: MapPlan, cells: Sequence[int], share: float) -> Columns:
    """Run some cells by `cells_of`; return their columns of the map's table."""
    columns: Columns = {
        "cell": list(cells),
        plan.x.name: [],
        plan.y.name: [],
        "verdict": [],
        "final_error": [],
        "lambda1_bits_per_s": [],
        "oscillation_amplitude": [],
        "reason": [],
    }
    with cells_of(plan, share) as cell_at:
        for cell in cells:
            x, y = plan.point(cell)
            found = cell_at(x, y)
            numbers = found.final_error, found.lambda1, found.oscillation
            row = (x, y, found.verdict.value, *numbers, found.reason)
            for name, value in zip(list(columns)[1:], row, strict=True):
                unknown = isinstance(value, float) and math.isnan(value)
                columns[name].append(None if unknown else value)
    return columns
