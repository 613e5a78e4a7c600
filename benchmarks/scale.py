"""Maps on Dask: time by number of workers, and memory of the scheduler by size of the map.

    python benchmarks/scale.py

Everything runs on this machine: a scheduler and workers as processes with one thread each. With
more workers than cores, only the overhead is visible. Prints wall time; memory is the largest
resident size of the scheduler and of the client process. The cost of 1e7 cells is the processor
time of one process per cell, from two sizes, times the number of cells, times the overhead of one
worker, without a network.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the command and its workers

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import psutil
from distributed.deploy.subprocess import SubprocessCluster

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.study.workers import Dask, Processes, Workers
from ballscrew.stability.stability_map import make_map, plan_map

MIB = 2**20
X, Y = "sigma0_hat=66965.89:66969.24:{}", "sigma1_hat=339.56:367.56:{}"


def seconds(workers: Workers, side: int) -> float:
    """Wall time of a map of Gamma_1 with `side` cells per side [s]."""
    plan = plan_map(Loop("iol", stop=20.0), X.format(side), Y.format(side), False)
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        make_map(plan, Path(folder), workers)
        return time.perf_counter() - began


def processor_seconds(side: int) -> float:
    """Processor time of this process for such a map [s]."""
    began = time.process_time()
    seconds(Processes(1), side)
    return time.process_time() - began


@contextmanager
def largest(*processes: psutil.Process) -> Iterator[list[float]]:
    """Largest resident size of each process within the block [MiB]."""
    sizes, done = [0.0] * len(processes), Event()

    def watch() -> None:
        while not done.wait(0.1):
            for k, process in enumerate(processes):
                sizes[k] = max(sizes[k], process.memory_info().rss / MIB)

    thread = Thread(target=watch)
    thread.start()
    yield sizes
    done.set()
    thread.join()


@contextmanager
def cluster(workers: int) -> Iterator[tuple[Dask, psutil.Process]]:
    """A scheduler with `workers` workers, and the scheduler's process."""
    with SubprocessCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as made:
        dask = Dask(made.scheduler_address)
        yield dask, psutil.Process(dask.client.run_on_scheduler(os.getpid))
        dask.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=32, help="cells of a side")
    side = parser.parse_args().side
    cells = side * side
    seconds(Processes(1), 4)  # compiles the loop
    used = [processor_seconds(s) for s in (side // 2, side)]
    each = (used[1] - used[0]) / (cells - cells // 4)
    alone = seconds(Processes(1), side)
    print(f"{os.cpu_count()} cores, {cells} cells\n")
    print(f"{'workers':<22}{'s':>8}{'cells/s':>10}{'ratio to one process':>22}")
    print(f"{'one process, no Dask':<22}{alone:>8.1f}{cells / alone:>10.0f}{1.0:>22.2f}")
    overhead = 1.0
    for workers in (1, 2, 3, 4):
        with cluster(workers) as (dask, _):
            seconds(dask, 4)
            took = seconds(dask, side)
        overhead = took / alone if workers == 1 else overhead
        print(f"{workers:<22}{took:>8.1f}{cells / took:>10.0f}{alone / took:>22.2f}", flush=True)
    print(f"\n{'cells':<12}{'s':>8}{'scheduler MiB':>16}{'asking process MiB':>20}")
    with cluster(2) as (dask, scheduler):
        seconds(dask, 4)
        for longer in (1, 2, 4):
            with largest(scheduler, psutil.Process()) as sizes:
                took = seconds(dask, longer * side)
            print(
                f"{longer**2 * cells:<12}{took:>8.1f}{sizes[0]:>16.0f}{sizes[1]:>20.0f}", flush=True
            )
    print(
        f"\na cell: {1e3 * each:.1f} ms of a processor; "
        f"one worker on Dask takes {overhead:.2f} times as long"
    )
    print(f"1e7 cells: {1e7 * each * max(overhead, 1.0) / 3600:.0f} core hours")


if __name__ == "__main__":
    main()
