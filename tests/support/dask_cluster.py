"""A Dask scheduler and workers, as separate processes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ballscrew.orchestration.study.workers import Dask

WAIT = 60.0  # [s]


class Processes(list[subprocess.Popen]):
    """Processes of the workers, without the scheduler."""

    def __init__(self, processes: list[subprocess.Popen]) -> None:
        self.scheduler = processes[0]
        super().__init__(processes[1:])


@contextmanager
def cluster(folder: Path, workers: int = 2, **variables: str) -> Iterator[tuple[Dask, Processes]]:
    """An executor on the cluster, and the processes of the workers; all end with the block.

    The workers' environment also has the variables.
    """
    place = folder / "scheduler.json"
    run = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0"]
    begun = [*run, "--no-dashboard", "--scheduler-file", str(place)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    processes = [subprocess.Popen(begun, **quiet)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(place)]
    worker += ["--nthreads", "1", "--no-dashboard", "--no-nanny"]
    deadline = time.monotonic() + WAIT

    def wait(ready) -> None:
        while not ready():
            assert time.monotonic() < deadline
            time.sleep(0.05)

    try:
        # the file exists before it is complete
        wait(lambda: place.is_file() and place.read_text().endswith("}"))
        environment = {**os.environ, **variables}
        for _ in range(workers):
            processes.append(subprocess.Popen(worker, env=environment, **quiet))
        dask = Dask(json.loads(place.read_text())["address"])
        try:
            wait(lambda: len(dask.client.scheduler_info()["workers"]) >= workers)
            yield dask, Processes(processes)
        finally:
            dask.close()
    finally:
        for process in processes:
            process.kill()
            process.wait()
