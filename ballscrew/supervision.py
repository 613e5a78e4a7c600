"""The command runs in a child process, so that an interrupt ends it at once, whatever it does.

Compiled code that runs for minutes, a third-party library or a picture being drawn do not look for
signals. The process that the user sees therefore does nothing but wait. At SIGINT or SIGTERM it
ends the child, sees to it that the results folder holds one whole run, prints one line that says
how far the work was, and exits with code 130. The child ends with it, however it ends.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

INTERRUPTED = 130
_BY_SIGNAL = 128  # and the signal's number, as shells have it
_SCRATCH, _NEW = "ballscrew-run-", ".new"
_PAGE = 4096  # bytes of a told text; one write, which a kill does not cut short
_HOW_FAR, _FOLDER, _KEPT = range(3)

_told = -1  # what the child tells the other process: a file in memory, a page for each text


def tell(how_far: str) -> None:
    """Say how far the command is, for the line that an interrupt prints."""
    _say(_HOW_FAR, how_far.encode())


def tell_folder(folder: Path) -> None:
    """Say where the results go, so that an interrupt leaves one whole run there."""
    _say(_FOLDER, os.fsencode(os.path.abspath(folder)))


def tell_kept(what: str) -> None:
    """Say what an interrupt leaves of this run; nothing if this is never called."""
    _say(_KEPT, what.encode())


def _say(page: int, text: bytes) -> None:
    if _told >= 0:
        os.pwrite(_told, text[:_PAGE].ljust(_PAGE, b"\0"), page * _PAGE)


def _heard(page: int) -> bytes:
    return os.pread(_told, _PAGE, page * _PAGE).rstrip(b"\0")


def supervised(command: Callable[[], int]) -> int:
    """Run a command in a child process and return its exit code, in either process."""
    global _told
    began = time.time()
    signals = {n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) != signal.SIG_IGN}
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_BLOCK, {*signals, signal.SIGCHLD})
    _told = os.memfd_create("told")
    scratch = _scratch_folder()
    until, held = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(held)
        return _run(command, until, signals, scratch)
    os.close(until)
    try:
        return _wait(child, signals, began)
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)


def _scratch_folder() -> str | None:
    """Make a place for temporary files, since what is ended by a signal does not tidy up."""
    try:
        new = tempfile.mkdtemp(_NEW, _SCRATCH)
        descriptor = os.open(new, os.O_RDONLY)  # locked until both processes end
        with contextlib.suppress(OSError):  # a file system that has no locks: nobody removes it
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        folder = new.removesuffix(_NEW)
        os.rename(new, folder)
    except OSError:  # nowhere to write: who needs a file will say so
        return None
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    return folder


def _remove_what_is_left(place: Path) -> None:
    """Remove folders of commands that were killed; those of living ones are locked."""
    for folder in place.glob(f"{_SCRATCH}*"):
        if folder.suffix == _NEW:  # not locked yet
            continue
        with contextlib.suppress(OSError):  # gone, nobody's folder, or locked
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.fstat(descriptor).st_uid == os.geteuid():
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(descriptor)


def _wait(child: int, signals: set[signal.Signals], began: float) -> int:
    """Wait for the child's end, or for a signal that asks for it; the exit code."""
    while True:
        number = signal.sigwait({*signals, signal.SIGCHLD})
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            if code >= 0:
                return code
            _tell_user(f"ended by {signal.Signals(-code).name}", began)
            return _BY_SIGNAL - code
        if number in signals:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            _tell_user("interrupted", began)
            return INTERRUPTED


def _run(
    command: Callable[[], int], until: int, signals: set[signal.Signals], scratch: str | None
) -> int:
    """What the child does."""
    from .orchestration.end_with_parent import end_when_closed

    end_when_closed(until)
    # A terminal sends its interrupt to the child, too, which leaves it to the parent. A handler
    # that does nothing is not handed on to the programs that the child starts; a signal that is
    # ignored or blocked would be.
    for number in signals:
        signal.signal(number, lambda _number, _frame: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {*signals, signal.SIGCHLD})
    if scratch is not None:
        _remove_what_is_left(Path(scratch).parent)
    return command()


def _tell_user(what: str, began: float) -> None:
    """The one line of a command that was ended."""
    far = _heard(_HOW_FAR).decode("utf-8", "replace")
    far = f", {far}" if far else ""
    line = f"{what} after {time.time() - began:.1f} s{far}; {_left(began)}"
    clear = "\r\033[K" if sys.stderr.isatty() else ""
    print(f"{clear}ballscrew: {' '.join(line.split())}", file=sys.stderr, flush=True)


def _left(began: float) -> str:
    """Finish or take back what the child left half written; say what is there."""
    where = _heard(_FOLDER)
    if not where:
        return "nothing was written"
    from .orchestration.run_folder import changed_since, settle

    folder = Path(os.fsdecode(where))
    try:
        notes = settle(folder)
        new = changed_since(folder, began)
    except OSError as error:
        return f"what {folder} holds is unknown: {error.strerror or error}"
    kept = _heard(_KEPT).decode("utf-8", "replace")
    if new:
        kept = f"all results were written to {folder}"
    return "; ".join([kept or f"nothing of this run is kept in {folder}", *notes])
