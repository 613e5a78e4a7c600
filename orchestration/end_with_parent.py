"""End a process when the one that started it is gone, however that one ended.

A process holds the reading end of a pipe whose only writing end its parent holds. When the parent
ends, the kernel closes that end and sends SIGKILL to the owner of the reading end. No code of this
process takes part, so that compiled code or a foreign library that never returns is ended, too.
This needs Linux; elsewhere a process ends when it is told to.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import select
import signal
import sys
from concurrent.futures import ProcessPoolExecutor


def end_when_closed(descriptor: int, whole_group: bool = False) -> None:
    """End this process when the last writing end of a pipe is closed.

    Parameters
    ----------
    descriptor : int
        Reading end of the pipe, which must not be shared with another process that calls this.
        Nothing may be written to the pipe.
    whole_group : bool
        Whether to end the whole process group, which this process must lead.
    """
    if not sys.platform.startswith("linux"):
        return
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, -os.getpid() if whole_group else os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGKILL)
    flags = fcntl.fcntl(descriptor, fcntl.F_GETFL)
    fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_ASYNC)
    poll = select.poll()
    poll.register(descriptor, 0)
    if poll.poll(0):  # closed before the kernel was asked to tell
        os._exit(1)


def pool(processes: int) -> ProcessPoolExecutor:
    """Workers that end with this process.

    They are spawned: what is forked would hold the pipe on whose end its siblings wait.
    """
    # Python's own process that clears up after a killed one tells the user of its work
    quiet = "ignore:resource_tracker"
    told = os.environ.get("PYTHONWARNINGS", "").split(",")
    if quiet not in told:
        os.environ["PYTHONWARNINGS"] = ",".join([*filter(None, told), quiet])
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the workers are the threads
    return ProcessPoolExecutor(
        processes, multiprocessing.get_context("spawn"), initializer=_end_with_parent
    )


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("this process was not started by multiprocessing")
    end_when_closed(parent.sentinel)
