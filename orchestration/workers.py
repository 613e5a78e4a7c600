"""Where the chunks of a map are computed: here, in processes of this machine, or on Dask."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice
from typing import Any, Protocol

from .end_with_parent import pool

AHEAD = 2  # tasks per worker that wait, so that memory stays bounded as maps grow


class WorkersLost(RuntimeError):
    """Tasks could not be computed anywhere; the message says why and what to do."""


class Workers(Protocol):
    """Computes many tasks, in whatever order they finish."""

    def map(
        self, function: Callable[..., Any], tasks: Iterator[tuple[str, tuple[Any, ...]]]
    ) -> Iterator[tuple[str, Any]]:
        """Yield each task's name and its result as they come.

        Raises
        ------
        WorkersLost
        """
        ...


class Processes:
    """Processes of this machine; one means no other than this one."""

    def __init__(self, count: int) -> None:
        self.count = count

    def map(
        self, function: Callable[..., Any], tasks: Iterator[tuple[str, tuple[Any, ...]]]
    ) -> Iterator[tuple[str, Any]]:
        if self.count == 1:
            for name, arguments in tasks:
                yield name, function(*arguments)
            return
        from concurrent.futures.process import BrokenProcessPool

        with pool(self.count) as workers:
            waiting: dict[Future[Any], str] = {}
            try:
                while True:
                    for name, arguments in islice(tasks, self.count * AHEAD - len(waiting)):
                        waiting[workers.submit(function, *arguments)] = name
                    if not waiting:
                        return
                    done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        yield waiting.pop(future), future.result()
            except BrokenProcessPool as error:
                raise WorkersLost(
                    "a worker process ended unexpectedly; finish the map with --resume"
                ) from error
            except GeneratorExit:
                workers.shutdown(wait=False, cancel_futures=True)
                raise


class Dask:
    """Workers of a Dask scheduler; what a worker had in hand when it died goes to another.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``.

    Raises
    ------
    WorkersLost
        If nobody answers there, or `distributed` is not installed.
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise WorkersLost(
                "--dask needs Dask's scheduler: pip install 'ballscrew[dask]'"
            ) from None
        try:
            _answers(address, timeout)
            self.client = Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise WorkersLost(f"no Dask scheduler answers at {address}: {error}") from None

    def map(
        self, function: Callable[..., Any], tasks: Iterator[tuple[str, tuple[Any, ...]]]
    ) -> Iterator[tuple[str, Any]]:
        from distributed import as_completed

        def submit(count: int) -> list[Any]:
            return [
                self.client.submit(_named, function, name, arguments, pure=False, retries=5)
                for name, arguments in islice(tasks, count)
            ]

        workers = max(1, len(self.client.scheduler_info()["workers"]))
        tasks_in_hand = submit(workers * AHEAD)
        running = as_completed(tasks_in_hand, loop=self.client.loop, with_results=True)
        for future, result in running:
            yield result
            future.release()
            for new in submit(1):
                running.add(new)

    def close(self) -> None:
        self.client.close()


def _answers(address: str, timeout: float) -> None:
    """Make sure that somebody listens there: a client that fails is noisy and slow to end.

    Raises
    ------
    OSError, ValueError
    """
    from distributed.comm.addressing import get_address_host_port

    host, port = get_address_host_port(address)
    socket.create_connection((host, port), timeout).close()


def _named(function: Callable[..., Any], name: str, arguments: tuple[Any, ...]) -> tuple[str, Any]:
    return name, function(*arguments)
