"""How costs grow: workers and cells of a map, rows of a record, variables of an FMU.

On one machine; with more workers than cores only their overhead is visible.
"""

from __future__ import annotations

import os
import tempfile
import time
from functools import partial
from pathlib import Path

import fmpy
import numpy as np
import small_fmus
from distributed.deploy.subprocess import SubprocessCluster
from report import OURS, Cost, Works, timed

import ballscrew
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.study.workers import Dask, Processes, Workers
from ballscrew.stability.stability_map import make_map, plan_map

SIDE = 32  # cells of a map
X, Y = "sigma0_hat=66965.89:66969.24:{}", "sigma1_hat=339.56:367.56:{}"
ROWS = 10_000, 100_000, 1_000_000, 4_000_000  # more than 5 million are refused
VARIABLES = 10, 100, 1000, 10_000, 100_000


def mapped(workers: Workers, side: int) -> float:
    """Wall time of a map of Gamma_1 [s]."""
    plan = plan_map(Loop("iol", stop=20.0), X.format(side), Y.format(side))
    with tempfile.TemporaryDirectory() as folder:
        return timed(lambda: make_map(plan, Path(folder), workers))[0]


def peak(process: int | str = "self") -> float:
    """Largest resident size of a process up to now [MiB], as Linux counts it."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def on_dask(workers: int, side: int) -> Cost:
    """A map on a scheduler and workers of this machine, one thread each."""
    with SubprocessCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as made:
        dask = Dask(made.scheduler_address)
        mapped(dask, 4)  # compiles the loop
        took = mapped(dask, side)
        size = peak(dask.client.run_on_scheduler(os.getpid))
        dask.close()
    return Cost(took, f"{size:.0f} MiB in the scheduler")


def alone(side: int) -> Cost:
    mapped(Processes(1), 4)
    before = time.process_time()
    took = mapped(Processes(1), side)
    each = (time.process_time() - before) / side**2
    return Cost(took, f"{1e3 * each:.1f} ms of a processor for a cell")


def maps(_: Path) -> Works:
    """Maps on Dask

    Gamma_1, wall time with borders and pictures, beside one process without Dask; and the largest
    resident size of the scheduler.
    """

    def on(workers: int, side: int) -> dict[str, partial[Cost]]:
        return {f"Dask, {workers} workers": partial(on_dask, workers, side)}

    programs = {OURS: partial(alone, SIDE)}
    for workers in (1, 2, 3, 4):
        programs |= on(workers, SIDE)
    larger = {f"{(k * SIDE) ** 2} cells": on(2, k * SIDE) for k in (2, 4)}
    return {f"{SIDE**2} cells": programs, **larger}


def records(folder: Path) -> Works:
    """Records

    A CSV table of time, force and position is read. The largest resident size is that of this
    process up to then.
    """

    def cost(path: Path) -> Cost:
        took, _ = timed(lambda: ballscrew.read_force_records(path))
        return Cost(took, f"{peak():.0f} MiB")

    def programs(rows: int) -> dict[str, partial[object]]:
        path, piece = folder / f"{rows}.csv", min(rows, 100_000)
        with path.open("w", encoding="utf-8") as file:
            file.write("time,force,x\n")
            for first in range(0, rows, piece):
                t = 1e-3 * np.arange(first, first + piece)
                np.savetxt(file, np.column_stack([t, np.sin(t), 0.1 * np.cos(t)]), "%.10g", ",")
        numpy = partial(np.loadtxt, path, delimiter=",", skiprows=1)
        return {OURS: partial(cost, path), "numpy.loadtxt": numpy}

    return {f"{rows} rows": programs(rows) for rows in ROWS}


def variables(folder: Path) -> Works:
    """FMUs of many variables

    An FMU of so many outputs, opened and run for ten steps, all outputs recorded.
    """

    def programs(count: int) -> dict[str, partial[object]]:
        path = folder / f"outputs_{count}.fmu"
        outputs = [(f"y{k}", "output", None, "") for k in range(count)]
        small_fmus.build(str(path), f"outputs_{count}", outputs, deps=False)
        ours = partial(ballscrew.run, "none", path, stop=0.01, step=1e-3)
        theirs = partial(fmpy.simulate_fmu, str(path), stop_time=0.01, output_interval=1e-3)
        return {OURS: ours, "FMPy": theirs}

    return {f"{count} outputs": programs(count) for count in VARIABLES}


TABLES = maps, records, variables
