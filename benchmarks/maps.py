"""Cells of a stability map beside plain runs of the same loops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import process_time

from report import OURS, Cost, Program, Works

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.kernel import IntegrationError
from ballscrew.stability.map_plan import kernel_of, model_at, run_cell
from ballscrew.stability.stability_map import plan_map

X, Y = "sigma0_hat=66965.89:66969.24:34", "sigma1_hat=339.56:367.56:24"
STOP = 20.0  # s
Point = tuple[float, float]


def each(run: Callable[[Point], object], points: list[Point]) -> Cost:
    """Processor time of a cell, the mean over some."""
    began = process_time()
    for point in points:
        run(point)
    return Cost((process_time() - began) / len(points))


def cells(exponents: bool) -> Works:
    """The cells of each verdict, and plain runs with the same solver and tolerance."""
    plan = plan_map(Loop("iol", stop=STOP), X, Y, exponents)
    kernel = kernel_of(plan)
    kernel.compile()
    how = plan.tolerance, kernel.system()

    def cell(point: Point) -> object:
        return run_cell(plan, *point, *how)

    def plain(point: Point) -> None:
        with suppress(IntegrationError):  # some diverge
            model_at(plan, *point, *how).advance(0.0, STOP)

    found = defaultdict[str, list[Point]](list)
    for point in map(plan.point, range(plan.cells)):
        found[cell(point).verdict.value].append(point)

    def programs(points: list[Point]) -> dict[str, Program]:
        return {OURS: partial(each, cell, points), "a plain run": partial(each, plain, points)}

    works = {f"{v}, {len(p)} cells": programs(p) for v, p in sorted(found.items())}
    return {"all": programs([p for points in found.values() for p in points]), **works}


def by_motion(_: Path) -> Works:
    """A cell of the map Gamma_1, verdict from the motion

    816 cells of the map on the page of stability; processor time of one of them. A plain run
    simulates the loop over the cell's 20 s, without a verdict.
    """
    return cells(exponents=False)


def with_exponents(_: Path) -> Works:
    """A cell of the map Gamma_1 with the largest exponent

    The same cells; the tolerance is smaller, also in the plain runs.
    """
    return cells(exponents=True)


TABLES = by_motion, with_exponents
