"""The command runs in a child process, so that an interrupt always ends it at once.

Compiled code that runs for minutes, third-party libraries and plotting do not check for signals.
The process that the user sees therefore only waits. At SIGINT or SIGTERM it ends the child, makes
sure that the results folder contains one complete run, prints one line about the progress, and
exits with code 130. Where the system does not support this, the command runs in the process that
the user sees, and an interrupt is handled when Python code runs again.
"""

from __future__ import annotations

import contextlib
import itertools
import mmap
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from .orchestration.fmu.operating_system import (
    can_supervise,
    fork,
    hold_interrupts,
    lock,
    outcome,
)
from .printable import printable

INTERRUPTED = 130
_BY_SIGNAL = 128  # and the signal's number, as in shells
_SCRATCH, _NEW = "ballscrew-run-", ".new"
_HOW_FAR, _FOLDER, _KEPT = range(3)

_LONGEST = 4096  # bytes of a message
_told: mmap.mmap | None = None  # messages from the child to the other process
_began = time.time()


def tell(how_far: str) -> None:
    """Store the progress, for the line that an interrupt prints."""
    _say(_HOW_FAR, how_far.encode())


def tell_folder(folder: Path) -> None:
    """Store the results folder, so that an interrupt leaves one complete run there."""
    _say(_FOLDER, os.fsencode(os.path.abspath(folder)))


def tell_kept(what: str) -> None:
    """Store what an interrupt leaves of this run; default: nothing."""
    _say(_KEPT, what.encode())


def _say(number: int, text: bytes) -> None:
    if _told is not None:
        begin = number * _LONGEST
        _told[begin : begin + _LONGEST] = text[:_LONGEST].ljust(_LONGEST, b"\0")


def _heard(number: int) -> bytes:
    begin = number * _LONGEST
    return b"" if _told is None else _told[begin : begin + _LONGEST].rstrip(b"\0")


def supervised(command: Callable[[], int]) -> int:
    """Run a command in a child process and return its exit code, in either process."""
    global _told
    _told = mmap.mmap(-1, 3 * _LONGEST)  # shared with the child
    if not can_supervise():
        return command()
    signals = hold_interrupts()
    scratch = _scratch_folder()
    child = fork(signals)
    if child == 0:
        if scratch is not None:
            _remove_what_is_left(Path(scratch).parent)
        return command()
    try:
        code, how = outcome(child, signals)
        if how == "interrupted":
            return interrupted()
        if how:
            _tell_user(how)
        return code if code >= 0 else _BY_SIGNAL - code
    finally:
        if scratch is not None:
            _remove(Path(scratch))


def interrupted() -> int:
    """Print the one line of a command that was interrupted; its exit code."""
    _tell_user("interrupted")
    return INTERRUPTED


def _scratch_folder() -> str | None:
    """Make a folder for temporary files, since a process ended by a signal does not clean up."""
    try:
        new = tempfile.mkdtemp(_NEW, _SCRATCH)
        lock(Path(new))  # until both processes end; not removed if there are no locks
        folder = new.removesuffix(_NEW)
        os.rename(new, folder)
    except OSError:  # no writable folder: the code that needs a file reports it
        return None
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    return folder


def _remove_what_is_left(place: Path) -> None:
    """Remove folders of killed commands; folders of running commands are locked."""
    for folder in place.glob(f"{_SCRATCH}*"):
        if folder.suffix == _NEW:  # not locked yet
            continue
        with contextlib.suppress(OSError):  # removed, another user's folder, or locked
            descriptor = lock(folder, left=True)
            _remove(folder)
            os.close(descriptor)


def _remove(folder: Path) -> None:
    """Remove a folder as far as possible; what is in folders is moved up, so no path gets long."""
    names, stuck = itertools.count(), set[str]()
    with contextlib.suppress(OSError):
        while found := [e for e in os.scandir(folder) if e.name not in stuck]:
            for entry in found:
                try:
                    if entry.is_dir(follow_symlinks=False):
                        for inner in os.scandir(entry):
                            os.rename(inner, folder / f"{_SCRATCH}{next(names)}")
                        os.rmdir(entry)
                    else:
                        os.unlink(entry)
                except OSError:
                    stuck.add(entry.name)
        folder.rmdir()


def _tell_user(what: str) -> None:
    """The one line about an interrupted command."""
    far = _heard(_HOW_FAR).decode("utf-8", "replace")
    far = f", {far}" if far else ""
    line = f"{what} after {time.time() - _began:.1f} s{far}; {_left()}"
    clear = "\r\033[K" if sys.stderr.isatty() else ""
    line = printable(" ".join(line.split()))
    print(f"{clear}ballscrew: {line}", file=sys.stderr, flush=True)


def _left() -> str:
    """Complete or undo what the child left half written; say what the folder contains."""
    where = _heard(_FOLDER)
    if not where:
        return "nothing was written"
    from .orchestration.loop.run_folder import changed_since, settle

    folder = Path(os.fsdecode(where))
    try:
        notes = settle(folder)
        new = changed_since(folder, _began)
    except OSError as error:
        return f"what {folder} contains is unknown: {error.strerror or error}"
    kept = _heard(_KEPT).decode("utf-8", "replace")
    if new:
        kept = f"all results were written to {folder}"
    return "; ".join([kept or f"nothing of this run is kept in {folder}", *notes])
