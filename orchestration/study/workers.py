"""Long work in tasks: who computes them, and where their results are kept until all are done."""

from __future__ import annotations

import contextlib
import json
import logging
import shutil
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent import futures
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

from ...solver.errors import UserError
from ...solver.files import write_atomically
from ..fmu.operating_system import pool

AHEAD = 2  # tasks per worker that wait, so that memory stays bounded as maps grow
PATIENCE = 10.0  # s without a worker, in which one may come
CHECK = 2.0  # s between two checks of the workers
_NOISY = ("distributed", "tornado", "asyncio")
_INSTALL = "install the same version of ballscrew there"

Function: TypeAlias = Callable[..., Any]
Jobs: TypeAlias = Mapping[str, tuple[Any, ...]]  # arguments of tasks, by their names
Tasks: TypeAlias = Iterator[tuple[str, tuple[Any, ...]]]  # the same, one by one


class Processes:
    """Processes of this machine; 1 means only this process."""

    def __init__(self, count: int) -> None:
        self.count = count

    def map(self, function: Function, tasks: Tasks) -> Iterator[tuple[str, Any]]:
        """Yield the name and result of each task when it is finished; raises `UserError`."""
        if self.count == 1:
            yield from ((name, function(*arguments)) for name, arguments in tasks)
            return
        with pool(self.count) as workers:
            try:
                yield from _as_finished(workers, self.count, function, tasks, lambda: None)
            except futures.BrokenExecutor as error:
                raise UserError("a worker process ended; continue with --resume") from error
            except GeneratorExit:
                workers.shutdown(wait=False, cancel_futures=True)
                raise


def _as_finished(
    executor: futures.Executor, workers: int, function: Function, tasks: Tasks, check: Function
) -> Iterator[tuple[str, Any]]:
    """Submit tasks, a few for each worker at a time; `check` is called while none is finished."""
    waiting: dict[futures.Future[Any], str] = {}
    while True:
        for name, arguments in islice(tasks, workers * AHEAD - len(waiting)):
            waiting[executor.submit(function, *arguments)] = name
        if not waiting:
            return
        done = futures.wait(waiting, CHECK, futures.FIRST_COMPLETED).done
        if not done:
            check()
        for future in done:
            yield waiting.pop(future), future.result()


class Dask:
    """Workers of a Dask scheduler; the tasks of a worker that died go to another one.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``.

    Raises
    ------
    UserError
        If no scheduler answers there, or `distributed` is not installed.
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        try:
            from distributed import Client
            from distributed.comm.addressing import get_address_host_port
        except ImportError:
            raise UserError("--dask needs Dask: pip install 'ballscrew[dask]'") from None
        for name in (*_NOISY, *logging.root.manager.loggerDict):  # an error is one line
            if name.partition(".")[0] in _NOISY:
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        self.address = address
        try:
            # whether anybody listens: a client that fails tries for long
            socket.create_connection(get_address_host_port(address), timeout).close()
            self.client = Client(address, timeout=timeout, set_as_default=False)
        except Exception as error:  # another program's answer can cause any error
            why = str(error) or type(error).__name__
            raise UserError(f"no Dask scheduler responds at {address}: {why}") from None

    def map(self, function: Function, tasks: Tasks) -> Iterator[tuple[str, Any]]:
        """As that of `Processes`."""
        executor: Any = self.client.get_executor(pure=False, retries=5)
        workers = max(1, len(self.client.scheduler_info()["workers"]))
        self._heard = time.monotonic()  # of a worker
        try:
            for found in _as_finished(executor, workers, function, tasks, self._check):
                yield found
                self._heard = time.monotonic()
        except Exception as error:
            if why := _of_dask(error):
                raise self._lost(why) from error
            raise

    def _check(self) -> None:
        """Raise `UserError` if there has been no worker for long."""
        try:
            scheduler: Any = self.client.scheduler
            identity: Any = self.client.sync(scheduler.identity, callback_timeout=CHECK)
        except (OSError, TimeoutError):
            why = "does not answer"
        else:
            if identity["workers"]:
                self._heard = time.monotonic()
            why = "has no worker: start one with the same version of ballscrew"
        if time.monotonic() - self._heard > PATIENCE:
            raise self._lost(f"{why} (waited {PATIENCE:.0f} s)")

    def _lost(self, why: str) -> UserError:
        with contextlib.suppress(Exception):
            self.client.close(timeout=1)
        return UserError(
            f"the Dask scheduler at {self.address} {why}; finished work is kept, continue with "
            "--resume"
        )

    def close(self) -> None:
        self.client.close()


Workers: TypeAlias = Processes | Dask


def _of_dask(error: Exception) -> str:
    """Why Dask could not do a task; empty for an error of the task itself."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    if isinstance(error, ImportError | KilledWorker) or "deserializ" in str(error):
        return f"cannot run the task: {_INSTALL} ({error.__cause__ or error})"
    return "is gone" if isinstance(error, CommClosedError | futures.CancelledError) else ""


class KeptParts:
    """Finished tasks of one work, a file each; `digest` is of everything that determines them.

    Each file has the digest: another work in the same folder never uses it. The folder is made with
    the first part: work that ends earlier leaves nothing.
    """

    def __init__(self, folder: Path, digest: str) -> None:
        self.folder = folder
        self.digest = digest

    def claim(self, work: str, resume: bool) -> None:
        """Reject a folder that contains other parts, raises `UserError`."""
        place = self.folder.parent
        found = {_read(path)[0] for path in self.folder.glob("*.json")} - {None}
        if self.digest in found and not resume:
            raise UserError(f"{place} contains this {work}, unfinished; add --resume to continue")
        if found and self.digest not in found:
            raise UserError(f"{place} contains another {work}; choose another folder, or remove it")
        if resume and not found:
            raise UserError(f"{place} contains no {work} to continue; remove --resume to start one")

    def read(self, name: str) -> Any:
        """Result of a task; None if it is not done, or if its file is incomplete."""
        digest, found = _read(self.folder / name)
        return found if digest == self.digest else None

    def write(self, name: str, found: Any) -> None:
        """Keep what a task found; raises OSError."""
        content = {"of": self.digest, "found": found}
        write_atomically(self.folder / name, json.dumps(content).encode())

    def results(
        self, jobs: Jobs, function: Function, workers: Workers, fits: Function = lambda *_: True
    ) -> Iterator[tuple[str, Any]]:
        """Yield the name and result of each job: finished ones first, the others as they end.

        `fits` says whether a result, after its name, belongs to its job.
        """
        missing = {}
        for name, job in jobs.items():
            found = self.read(name)
            if found is not None and fits(name, found):
                yield name, found
            else:
                missing[name] = job
        for name, found in workers.map(function, iter(missing.items())):
            self.write(name, found)
            yield name, found

    def discard(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def _read(path: Path) -> tuple[str | None, Any]:
    """The digest in a file, and what was found; none in a file that is not complete.

    The digest of another program's file is empty.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None, None
    if isinstance(content, dict) and set(content) == {"of", "found"}:
        return str(content["of"]), content["found"]
    return "", None
