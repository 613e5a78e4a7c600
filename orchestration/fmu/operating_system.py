"""All use of the operating system, except files and their names, is in this module.

Locks, interrupts, processes that end with others, and limits of memory. Each function has a branch
for systems that lack what Linux has. The end of a process together with another works as follows:
it holds the reading end of a pipe whose only writing end its parent holds. When the parent ends in
any way, the kernel closes that end and on Linux sends SIGKILL to the owner of the reading end. No
code of this process takes part, so that compiled code or a foreign library that never returns is
ended, too. On other systems, a thread waits for the end of the pipe.

This module imports little, and nothing of this package: the command runs it first.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    import socket
    from concurrent.futures import ProcessPoolExecutor
    from pathlib import Path
    from subprocess import Popen

_LOCK = ".lock"  # if a folder itself cannot be locked
_ADOPT = 36  # PR_SET_CHILD_SUBREAPER: orphans of children become children
_PAUSE = 0.05  # s, between two checks of a lock of another process
_PAGE = 4096  # bytes of a text; written in one call, which a kill does not interrupt


# -- locks ---------------------------------------------------------------------------------------


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder; the lock also ends with this process."""
    descriptor = lock(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def lock(folder: Path) -> int:
    """Wait for a folder and lock it; without effect on a file system without locks.

    The lock ends when all processes that have the returned descriptor have closed it, or ended.
    """
    if sys.platform == "win32":
        import msvcrt

        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT)
        while True:
            try:
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
                return descriptor
            except PermissionError:  # another process has it
                time.sleep(_PAUSE)
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    with contextlib.suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return descriptor


def lock_if_left(folder: Path) -> int:
    """Lock a folder that a process of this user has left behind; Linux only.

    Raises
    ------
    OSError
        If it is a link, belongs to another user, or is locked by a running process.
    """
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_uid != os.geteuid():
            raise PermissionError(f"{folder} belongs to another user")
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


# -- interrupts, and the command in a child process ----------------------------------------------


def can_supervise() -> bool:
    """Whether the command can run in a child process that can always be ended at once."""
    return sys.platform.startswith("linux")


def hold_interrupts() -> set[signal.Signals]:
    """Block the signals that request an end until there is a handler for them, see `outcome`.

    Returns
    -------
    set of Signals
        SIGINT and SIGTERM, without ignored ones.
    """
    signals = {n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) != signal.SIG_IGN}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    return signals


def fork(signals: set[signal.Signals]) -> int:
    """Fork a child that ends with this process; `outcome` waits for it.

    Returns
    -------
    int
        0 in the child, which leaves the `signals` to its parent; the child's number in the parent.
    """
    import ctypes

    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    ctypes.CDLL(None).prctl(_ADOPT, 1, 0, 0, 0)
    until, held = os.pipe()
    child = os.fork()
    if child:
        os.close(until)
        return child
    os.close(held)
    end_when_closed(until)
    # A terminal also sends its interrupt to the child. The programs that the child starts do not
    # inherit a handler that does nothing; they would inherit ignored or blocked signals.
    for number in signals:
        signal.signal(number, lambda _number, _frame: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {*signals, signal.SIGCHLD})
    return 0


def outcome(child: int, signals: set[signal.Signals]) -> tuple[int, str]:
    """Wait for a child's end, or for a signal that requests it.

    Returns its exit code, or minus the signal that ended it; and ``interrupted`` by one of
    `signals`, ``ended by`` another, or nothing.
    """
    while True:
        number = signal.sigwait({*signals, signal.SIGCHLD})
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            _end_children()
            code = os.waitstatus_to_exitcode(status)
            return code, f"ended by {_signal_name(-code)}" if code < 0 else ""
        if number in signals:
            _end_children()
            return -number, "interrupted"


def _end_children() -> None:
    """End all that the command has started; what a parent leaves behind is adopted here."""
    while children := [n for n in os.listdir("/proc") if n.isdigit() and _is_child(n)]:
        for child in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(child), signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(int(child), 0)


def _is_child(process: str) -> bool:
    with contextlib.suppress(OSError), open(f"/proc/{process}/stat", "rb") as stat:
        return int(stat.read().rpartition(b")")[2].split()[1]) == os.getpid()
    return False


class Told:
    """Short texts by number, which the other process of a fork reads.

    On Linux they are in a file in memory, each in its own page, so that they are always complete.
    """

    def __init__(self) -> None:
        self._file = os.memfd_create("told") if sys.platform.startswith("linux") else -1
        self._texts: dict[int, bytes] = {}

    def say(self, number: int, text: bytes) -> None:
        """Replace a text."""
        if self._file >= 0:
            os.pwrite(self._file, text[:_PAGE].ljust(_PAGE, b"\0"), number * _PAGE)
        else:
            self._texts[number] = text

    def heard(self, number: int) -> bytes:
        """A text; empty if it was never set."""
        if self._file >= 0:
            return os.pread(self._file, _PAGE, number * _PAGE).rstrip(b"\0")
        return self._texts.get(number, b"")


# -- processes that end with the one that started them -------------------------------------------


def end_when_closed(descriptor: int, whole_group: bool = False) -> None:
    """End this process, or the group that it leads, when the last writing end of a pipe is closed.

    The reading end must not be shared with another process that calls this, and nothing may be
    written to the pipe.
    """
    if not sys.platform.startswith("linux"):
        _end_after(lambda: os.read(descriptor, 1))
        return
    import fcntl
    import select

    fcntl.fcntl(descriptor, fcntl.F_SETOWN, -os.getpid() if whole_group else os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGKILL)
    flags = fcntl.fcntl(descriptor, fcntl.F_GETFL)
    fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_ASYNC)
    poll = select.poll()
    poll.register(descriptor, 0)
    if poll.poll(0):  # closed before the signal was requested from the kernel
        os._exit(1)


def _end_after(wait: Callable[[], Any]) -> None:
    """End this process when a function returns; from a thread, which needs the interpreter."""
    import threading

    def end() -> None:
        with contextlib.suppress(OSError):
            wait()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def pool(processes: int) -> ProcessPoolExecutor:
    """Workers that end with this process.

    They are spawned: a forked worker would hold the pipe whose end the other workers wait for.
    """
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    # Python's own process that cleans up after a killed one prints messages for the user
    quiet = "ignore:resource_tracker"
    told = os.environ.get("PYTHONWARNINGS", "").split(",")
    if quiet not in told:
        os.environ["PYTHONWARNINGS"] = ",".join([*filter(None, told), quiet])
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the workers are the threads
    return ProcessPoolExecutor(
        processes, multiprocessing.get_context("spawn"), initializer=_end_with_parent
    )


def _end_with_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("this process was not started by multiprocessing")
    if sys.platform.startswith("linux"):
        end_when_closed(parent.sentinel)
    else:  # not a pipe everywhere
        _end_after(parent.join)


# -- a process that runs foreign code ------------------------------------------------------------


def start_host(
    module: str, folder: Path, prints: int
) -> tuple[socket.socket, Popen[bytes], BinaryIO]:
    """Start a fresh interpreter that runs ``main(connection)`` of a module of this package.

    It works in `folder`, does not get Ctrl-C, and has no modules of the user on its path. `prints`
    is the descriptor for its output, which is closed here. Returns the other end of the connection,
    the process, and a file: when it is closed, at the latest at the end of this process, the host
    ends; on Linux with all processes that it has started itself.
    """
    import socket
    import subprocess
    from pathlib import Path

    where = str(Path(__file__).parents[3])  # of the package: the last folder of the host's path

    def started(descriptors: list[int], **how: Any) -> Popen[bytes]:
        code = (
            f"import sys; sys.path.append({where!r}); "
            f"from {__name__} import host_connection; "
            f"connection = host_connection({descriptors}); "
            f"from {module} import main; main(connection)"
        )
        command = [sys.executable, "-P", "-c", code]
        return subprocess.Popen(command, stdout=prints, stderr=prints, cwd=folder, **how)

    ours, theirs = socket.socketpair()
    try:
        if sys.platform == "win32":
            alone = subprocess.CREATE_NEW_PROCESS_GROUP
            process = started([], stdin=subprocess.PIPE, creationflags=alone)
            assert process.stdin is not None
            share = theirs.share(process.pid)
            process.stdin.write(len(share).to_bytes(4, "little") + share)
            process.stdin.flush()
            return ours, process, process.stdin
        until, held = os.pipe()
        try:
            process = started(
                [theirs.fileno(), until],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno(), until],
                start_new_session=True,
            )
        finally:
            os.close(until)
        return ours, process, open(held, "wb", buffering=0)
    finally:
        theirs.close()
        os.close(prints)


def host_connection(descriptors: list[int]) -> socket.socket:
    """The host's end of the connection of `start_host`; the host ends with its parent."""
    import socket

    if sys.platform == "win32":
        size = int.from_bytes(sys.stdin.buffer.read(4), "little")
        connection: socket.socket = socket.fromshare(sys.stdin.buffer.read(size))
        end_when_closed(0)
        return connection
    theirs, until = descriptors
    end_when_closed(until, whole_group=True)
    return socket.socket(fileno=theirs)


def end_host(process: Popen[bytes]) -> None:
    """End a process of `start_host`, and its child processes."""
    import subprocess

    if process.poll() is None:
        if sys.platform == "win32":
            tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
            subprocess.run(tree, capture_output=True, check=False)
            process.kill()  # no effect if it has ended
        else:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def how_ended(code: int) -> str:
    """The meaning of an exit code, as text that follows the name of a process."""
    if code >= 0xC0000000:  # an exception of Windows
        return f"was ended by exception {code:#x}"
    if code >= 0:
        return f"ended with exit code {code}"
    return f"was ended by {_signal_name(-code)}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


# -- memory --------------------------------------------------------------------------------------


def address_space() -> int | None:
    """Largest size that this process may have [bytes]; None if there is no limit."""
    if sys.platform == "win32":
        return None
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def free_memory() -> int | None:
    """Free memory of Windows [bytes]; None on other systems: see ``/proc``."""
    if sys.platform != "win32":
        return None
    import ctypes

    class Status(ctypes.Structure):
        """MEMORYSTATUSEX."""

        _fields_ = (
            ("length", ctypes.c_uint32),
            ("load", ctypes.c_uint32),
            *((name, ctypes.c_uint64) for name in "total free pages free_pages".split()),
            *((name, ctypes.c_uint64) for name in "space free_space extended".split()),
        )

    status = Status(length=ctypes.sizeof(Status))
    if not ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)):
        return None
    return min(int(status.free), int(status.free_pages))
