"""Workers of a command with many tasks: processes on this machine, or Dask."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from .options import read_whole_number

if TYPE_CHECKING:
    from .orchestration.study.workers import Workers

MOST_WORKERS = 1000


def add_worker_options(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", metavar="N", help="processes on this machine (default: one per core)"
    )
    where.add_argument(
        "--dask", metavar="ADDRESS", help="a Dask scheduler, such as tcp://host:8786"
    )


def read_worker_count(options: argparse.Namespace) -> int:
    """Number of processes; raises `UserError` for an invalid number."""
    if options.workers is None:
        return os.cpu_count() or 1
    return read_whole_number("--workers", options.workers, 1, MOST_WORKERS)


def open_workers(options: argparse.Namespace, count: int) -> Workers:
    """Dask if requested, else this number of processes; raises `UserError`."""
    from .orchestration.study.workers import Dask, Processes

    return Dask(options.dask) if options.dask else Processes(count)
