"""Sandbox for a third-party program: the words to put before a command.

bubblewrap, a program of Linux distributions (Flatpak uses it), gives a process its own name spaces.
The program can read the system's programs and libraries, the interpreter with this package, and the
unpacked FMU. It can write into one folder, which is its ``/tmp``. It has no network, sees no other
processes, and gets no environment variables of the user.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path

from ..solver.files import temporary_folder

FMU = "/fmu"  # where the program finds the unpacked FMU
_HERE = "/tmp"  # where it may write; its first working directory
_SYSTEM = (
    *(f"/{name}" for name in ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32")),
    *(f"/etc/{name}" for name in ("alternatives", "ld.so.cache", "ld.so.conf", "ld.so.conf.d")),
    "/nix/store",
    "/gnu/store",
)
_VARIABLES = {
    "PATH": "/usr/local/bin:/usr/bin:/bin",
    "HOME": _HERE,
    "TMPDIR": _HERE,
    "LANG": "C.UTF-8",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "1",
}
_PATIENCE = 60.0  # s, for a trial
# actions that must fail in a trial; it prints those that succeed
_TRIAL = """
import socket, sys
secret, port = sys.argv[1:]
def reads():
    open(secret).close()
def writes():
    open(secret + "-2", "x").close()
def connects():
    socket.create_connection(("127.0.0.1", int(port)), 2).close()
for act in reads, writes, connects:
    try:
        act()
        print(act.__name__)
    except OSError:
        pass
"""
_COULD = {
    "reads": "read a file outside of it",
    "writes": "write one there",
    "connects": "open a connection",
}


class NoSandbox(ValueError):
    """A program cannot be run in a sandbox here; the message says why, and what to do."""


def command(scratch: Path, fmu: Path | None = None) -> list[str]:
    """The words before a command that has to run in the sandbox.

    The thread that starts the process must live as long as the process: bubblewrap ends with it.

    Parameters
    ----------
    scratch : Path
        The one folder that the command can write into; it is its working directory.
    fmu : Path, optional
        A folder that it can read, as `FMU`.

    Returns
    -------
    list of str

    Raises
    ------
    NoSandbox
    """
    bwrap = _bwrap()
    _try_out(bwrap)
    return _words(bwrap, scratch, fmu)


def check_sandbox() -> None:
    """Make sure that a sandbox is available here, and that it is effective.

    Raises
    ------
    NoSandbox
    """
    _own_folders()
    _try_out(_bwrap())


def _bwrap() -> str:
    if not sys.platform.startswith("linux"):
        raise _none(f"bubblewrap is for Linux, and this is {sys.platform}", "run it on Linux")
    found = shutil.which("bwrap")
    if not found:
        install = "install it, as by `apt install bubblewrap`"
        raise _none("the program bwrap (bubblewrap) was not found", install)
    return os.path.abspath(found)


def _none(why: str, remedy: str) -> NoSandbox:
    return NoSandbox(
        f"no sandbox here: {why}; {remedy}, or leave out the sandbox and run only FMUs that you "
        "trust"
    )


def _words(bwrap: str, scratch: Path, fmu: Path | None) -> list[str]:
    seen = [("--ro-bind-try", place, place) for place in _SYSTEM]
    own = [("--ro-bind", place, place) for place in _own_folders()]
    shown = [] if fmu is None else [("--ro-bind", str(fmu), FMU)]
    variables = [("--setenv", name, value) for name, value in _VARIABLES.items()]
    steps = [
        *seen,
        ("--proc", "/proc"),
        ("--dev", "/dev"),
        ("--bind", str(scratch), _HERE),
        *own,  # after /tmp, because one of them may be in it
        *shown,
        ("--remount-ro", "/dev"),
        ("--remount-ro", "/"),
        ("--unshare-all",),  # users, processes, network, messages between processes, host name
        ("--cap-drop", "ALL"),
        ("--die-with-parent",),
        ("--new-session",),
        ("--clearenv",),
        *variables,
        ("--chdir", _HERE),
        ("--",),
    ]
    return [bwrap, *(word for step in steps for word in step)]


def _own_folders() -> list[str]:
    """Folders of the interpreter and this package, except those inside another visible folder."""
    import ballscrew

    package = str(Path(ballscrew.__file__).parents[1])
    folders = {os.path.abspath(p) for p in (sys.prefix, sys.base_prefix, package)}
    home = Path(os.path.realpath(os.path.expanduser("~")))
    own: list[str] = []
    for folder in sorted(folders):
        if any(Path(folder).is_relative_to(seen) for seen in (*_SYSTEM, *own)):
            continue
        if home.is_relative_to(os.path.realpath(folder)):
            raise _none(
                f"Python or this package lies in {folder}, which holds the home folder {home}, too",
                "install them in a folder of their own, as in a virtual environment",
            )
        own.append(folder)
    return own


@cache
def _try_out(bwrap: str) -> None:
    """Try forbidden actions in the sandbox: any program may have the name bwrap."""
    with temporary_folder("sandbox") as folder, socket.create_server(("127.0.0.1", 0)) as server:
        secret, scratch = Path(folder, "secret"), Path(folder, "scratch")
        secret.touch()
        scratch.mkdir()
        asked = [str(secret), str(server.getsockname()[1])]
        try:
            done = subprocess.run(
                [*_words(bwrap, scratch, None), sys.executable, "-I", "-S", "-c", _TRIAL, *asked],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=_PATIENCE,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _none(f"{bwrap} cannot be run ({error})", "mend that") from error
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise _none(
            f"{bwrap} says {said[-1]!r}",
            "allow user namespaces, or install bubblewrap 0.5 or later",
        )
    if done.stdout:
        could = ", ".join(_COULD.get(word, word) for word in done.stdout.split())
        raise _none(f"a trial under {bwrap} could {could}", "install bubblewrap")
