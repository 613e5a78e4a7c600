"""All use of the operating system, except files and their names, is in this module.

Locks, interrupts, processes that end with others, and memory, with a branch for systems that lack
what Linux has. It imports little, and nothing of this package: the command runs it first.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    import socket
    from concurrent.futures import ProcessPoolExecutor
    from subprocess import Popen

_ADOPT = 36  # PR_SET_CHILD_SUBREAPER: orphans of children become children
_PAUSE = 0.05  # s, between two checks of a lock of another process
_LARGEST = 1 << 28  # bytes of a line of another process
_SOON = 2e-4  # s, between two checks of a process that ends


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder; the lock also ends with this process."""
    descriptor = lock(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def lock(folder: Path, left: bool = False) -> int:
    """Wait for a folder and lock it; without effect on a file system without locks.

    The lock ends when all processes that have the returned descriptor have closed it, or ended.
    One that a process has `left` behind (Linux only) is not waited for: OSError, if it is a link,
    belongs to another user, or is locked by a running process.
    """
    if sys.platform == "win32":
        import msvcrt

        # a folder itself cannot be locked
        descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT)
        while True:
            try:
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
                return descriptor
            except PermissionError:  # another process has it
                time.sleep(_PAUSE)
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY | (os.O_DIRECTORY | os.O_NOFOLLOW if left else 0))
    try:
        if left and os.fstat(descriptor).st_uid != os.geteuid():
            raise PermissionError(f"{folder} belongs to another user")
        fcntl.flock(descriptor, fcntl.LOCK_EX | (fcntl.LOCK_NB if left else 0))
    except OSError:
        if left:
            os.close(descriptor)
            raise
    return descriptor


def can_supervise() -> bool:
    """Whether the command can run in a child process that can always be ended at once."""
    return sys.platform.startswith("linux")


def hold_interrupts() -> set[signal.Signals]:
    """Block the signals that request an end, except ignored ones, and return them."""
    signals = {n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) != signal.SIG_IGN}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    return signals


def fork(signals: set[signal.Signals]) -> int:
    """Fork a child that ends with this process; return its number, and 0 in the child itself.

    The child leaves the `signals` to its parent, which waits for it by `outcome`.
    """
    import ctypes

    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    ctypes.CDLL(None).prctl(_ADOPT, 1, 0, 0, 0)
    until, held = os.pipe()
    if child := os.fork():
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
        if not ended and number not in signals:
            continue
        _end_children()
        if not ended:
            return -number, "interrupted"
        code = os.waitstatus_to_exitcode(status)
        return code, how_ended(code).removeprefix("was ") if code < 0 else ""


def _end_children() -> None:
    """End all that the command has started; what a parent leaves behind is adopted here."""
    while children := [int(n) for n in os.listdir("/proc") if n.isdigit() and _is_child(n)]:
        for child in children:
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)


def _is_child(process: str) -> bool:
    with contextlib.suppress(OSError), open(f"/proc/{process}/stat", "rb") as stat:
        return int(stat.read().rpartition(b")")[2].split()[1]) == os.getpid()
    return False


def end_when_closed(descriptor: int, whole_group: bool = False) -> None:
    """End this process, or the group that it leads, when the last writing end of a pipe is closed.

    Its parent holds that end: when it ends in any way, the kernel closes it, and on Linux sends
    SIGKILL to the owner of the reading end. No code of this process takes part, so that compiled
    code that never returns is ended, too. The reading end must not be shared with another process
    that calls this, and nothing may be written to the pipe.
    """
    if not sys.platform.startswith("linux"):
        _end_after(lambda: os.read(descriptor, 1))
        return
    import fcntl
    import select

    fcntl.fcntl(descriptor, fcntl.F_SETOWN, -os.getpid() if whole_group else os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(descriptor, fcntl.F_SETFL, fcntl.fcntl(descriptor, fcntl.F_GETFL) | os.O_ASYNC)
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
    warnings, quiet = os.environ.get("PYTHONWARNINGS", ""), "ignore:resource_tracker"
    if quiet not in warnings.split(","):
        os.environ["PYTHONWARNINGS"] = f"{warnings},{quiet}".lstrip(",")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the workers are the threads
    spawned = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes, spawned, initializer=_end_with_parent)


def _end_with_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    assert parent is not None  # in a worker
    if sys.platform == "win32":
        _end_after(parent.join)
    else:
        end_when_closed(parent.sentinel)


def start_host(module: str, folder: Path) -> tuple[socket.socket, Popen[bytes] | _Forked]:
    """Start a process that runs ``main(connection)`` of a module of this package.

    It works in `folder`, does not get Ctrl-C, and has no modules of the user on its path. Returns
    the other end of the connection, and the process: its `stdout` has all output, and when its
    `stdin` is closed, at the latest at the end of this process, it ends with all that it started.
    """
    import socket
    import subprocess

    ours, theirs = socket.socketpair()
    with theirs:
        for _ in range(2 if can_supervise() else 0):  # again, if the one that forks was ended
            host = _server(os.getpid(), module).fork(folder, theirs.fileno())
            if host.pid > 0:
                return ours, host
            end_host(host, host.stdin, host.stdout)
            _server.cache_clear()
        code = f"from {module} import main; main(host_connection({theirs.fileno()}))"
        how: dict[str, Any] = {"start_new_session": True, "pass_fds": [theirs.fileno()]}
        if sys.platform == "win32":
            how = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        how |= {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        command = _fresh(f"from {__name__} import host_connection; {code}")
        process = subprocess.Popen(command, bufsize=0, cwd=folder, **how)
        if sys.platform == "win32":
            assert process.stdin is not None
            share = theirs.share(process.pid)
            process.stdin.write(len(share).to_bytes(4, "little") + share)
    return ours, process


def _fresh(code: str) -> list[str]:
    """The command of an interpreter that finds this package last, and nothing of the user."""
    where = str(Path(__file__).parents[3])
    return [sys.executable, "-P", "-c", f"import sys; sys.path.append({where!r}); {code}"]


def host_connection(descriptor: int) -> socket.socket:
    """The host's end of the connection of `start_host`; the host ends with its parent."""
    import socket

    if sys.platform == "win32":
        size = int.from_bytes(sys.stdin.buffer.read(4), "little")
        connection: socket.socket = socket.fromshare(sys.stdin.buffer.read(size))
        end_when_closed(0)
        return connection
    end_when_closed(os.dup(0), whole_group=True)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # foreign code reads nothing, and does not wait
    return socket.socket(fileno=descriptor)


class _Server:
    """A process that has a module of this package loaded, and forks the hosts that run it.

    Linux only. A host starts in milliseconds; a fresh interpreter takes most of a second.
    """

    def __init__(self, module: str) -> None:
        import socket
        import subprocess
        import threading
        import weakref

        self._connection, theirs = socket.socketpair()
        self._lock = threading.Lock()
        code = f"from {__name__} import fork_hosts; fork_hosts({theirs.fileno()}, {module!r})"
        how: dict[str, Any] = dict.fromkeys(("stdout", "stderr"), subprocess.DEVNULL)
        how |= {"stdin": subprocess.PIPE, "start_new_session": True, "pass_fds": [theirs.fileno()]}
        how["env"] = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # threads do not survive a fork
        with theirs:
            process = subprocess.Popen(_fresh(code), **how)
        weakref.finalize(self, self._connection.close)
        weakref.finalize(self, process.communicate)  # it ends when its input is closed

    def ask(self, request: Sequence[Any], *descriptors: int) -> int | None:
        """Send a request and files; the answer is negative if the process has ended."""
        import json
        import socket

        data = json.dumps(request).encode() + b"\n"
        with contextlib.suppress(OSError), self._lock:
            socket.send_fds(self._connection, [data[:1]], descriptors)
            self._connection.sendall(data[1:])
            return cast("int | None", json.loads(line_of(self._connection)))
        return -signal.SIGKILL

    def fork(self, folder: Path, connection: int) -> _Forked:
        """Start a host that has one end of the connection."""
        (until, stdin), (stdout, output) = os.pipe(), os.pipe()
        with open(until, "rb"), open(output, "wb"):
            pid = self.ask([str(folder), dict(os.environ)], until, output, connection)
        return _Forked(self, pid or 0, os.fdopen(stdin, "wb", 0), os.fdopen(stdout, "rb", 0))


_server = functools.cache(lambda _process, module: _Server(module))


class _Forked:
    """A process of a `_Server`, with what is used of a `Popen`."""

    def __init__(self, server: _Server, pid: int, stdin: Any, stdout: Any) -> None:
        self._server, self.pid, self.stdin, self.stdout = server, pid, stdin, stdout
        self.returncode: int | None = None if pid > 0 else pid  # it was not made

    def wait(self, timeout: float = math.inf) -> int | None:
        """Return the exit code, or None after the time limit [s]."""
        end = time.monotonic() + timeout
        while self.returncode is None:
            self.returncode = self._server.ask([self.pid])
            if time.monotonic() >= end:
                break
            time.sleep(_SOON)
        return self.returncode


def line_of(connection: socket.socket, limit: float | None = None) -> bytes:
    """A line, after which nothing follows; raises TimeoutError, and ConnectionError at the end."""
    end, data = time.monotonic() + (limit or 0.0), b""
    while b"\n" not in data:
        if limit is not None:
            connection.settimeout(max(end - time.monotonic(), _SOON))
        more = connection.recv(1 << 16)
        if not more or len(data) > _LARGEST:
            raise ConnectionError("the other process has closed the connection")
        data += more
    return data.partition(b"\n")[0]


def fork_hosts(descriptor: int, module: str) -> None:
    """Fork a host for each folder, and say how one has ended for each number of a process."""
    import importlib
    import json
    import socket

    end_when_closed(0)
    modules = module, "fmpy.fmi2", "fmpy.fmi3", "numpy.random"  # which the hosts need at once
    host, *_ = map(importlib.import_module, modules)
    host.library()  # its compiled code
    control = socket.socket(fileno=descriptor)
    while True:
        first, descriptors, *_ = socket.recv_fds(control, 1, 3)
        what, *environment = json.loads(first + line_of(control))
        if not environment:
            ended, status = os.waitpid(what, os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if ended else None
        elif answer := os.fork():
            with contextlib.suppress(OSError):  # the host did it, or has ended
                os.setpgid(answer, answer)
        else:
            control.close()
            _become_host(host.main, what, environment[0], descriptors)
        for number in descriptors:
            os.close(number)
        control.sendall(json.dumps(answer).encode() + b"\n")


def _become_host(main: Any, folder: str, environment: dict[str, str], files: list[int]) -> None:
    """Run `main` in this forked process."""
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        until, output, connection = files
        for source, target in ((until, 0), (output, 1), (output, 2)):
            os.dup2(source, target)
        main(host_connection(connection))
    finally:
        os._exit(1)


def end_host(process: Popen[bytes] | _Forked, *files: Any) -> None:
    """End a process of `start_host`, and its child processes; close these files."""
    if process.returncode is None:
        if sys.platform == "win32":
            import subprocess

            tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
            subprocess.run(tree, capture_output=True, check=False)
            process.kill()  # no effect if it has ended
        else:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for file in files:
        file.close()


def how_ended(code: int) -> str:
    """The meaning of an exit code, as text that follows the name of a process."""
    if code >= 0xC0000000:  # an exception of Windows
        return f"was ended by exception {code:#x}"
    if code >= 0:
        return f"ended with exit code {code}"
    names = {number.value: number.name for number in signal.Signals}
    return f"was ended by {names.get(-code, f'signal {-code}')}"


def available_memory() -> int | None:
    """Bytes that the system has left; None if it does not report it: only Linux does."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        words = Path("/proc/meminfo").read_text("ascii").split()
        return 1024 * int(words[words.index("MemAvailable:") + 1])
    return None
