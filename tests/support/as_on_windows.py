"""Make this interpreter look like one on Windows, for modules imported afterwards.

Third-party modules are imported before, unchanged. Then modules and functions that do not exist on
Windows are removed, and their Windows counterparts are added, as far as this package uses them.
"""

import ctypes
import importlib
import os
import signal
import socket
import sys
import types

THEIRS = (
    "asyncio concurrent.futures.process control cma ctypes.util fmpy fmpy.simulation jinja2 "
    "matplotlib.pyplot multiprocessing.connection multiprocessing.popen_spawn_posix "
    "multiprocessing.resource_tracker multiprocessing.synchronize numpy "
    "pythonfmu pythonfmu.builder scipy.fft scipy.integrate scipy.linalg scipy.optimize "
    "scipy.signal scipy.sparse.linalg scipy.special scipy.stats selectors subprocess sympy "
    "tempfile tomli_w tomllib tqdm uuid zipfile"
).split()
LACKS = {
    os: (
        "fork forkpty geteuid getuid getegid getgid getpgid getpgrp getsid killpg memfd_create "
        "mkfifo nice posix_fallocate pread pwrite sched_getaffinity setsid sysconf uname wait "
        "O_DIRECTORY O_NOFOLLOW O_NONBLOCK O_CLOEXEC"
    ),
    signal: "SIGKILL SIGCHLD SIGALRM SIGHUP SIGPIPE pthread_sigmask sigwait alarm setitimer",
}


def look_like_windows() -> None:
    """Change this interpreter as described above; no module of this package may be imported yet."""
    assert not any(name.partition(".")[0] == "ballscrew" for name in sys.modules)
    for name in THEIRS:
        importlib.import_module(name)
    import subprocess

    for module, names in LACKS.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    for name in ("fcntl", "resource", "grp", "pwd", "termios", "posix"):
        sys.modules[name] = None  # cannot be imported
    msvcrt = types.ModuleType("msvcrt")
    msvcrt.LK_NBLCK, msvcrt.locking = 2, lambda descriptor, mode, size: None
    sys.modules["msvcrt"] = msvcrt
    kernel = types.SimpleNamespace(GlobalMemoryStatusEx=lambda status: 0)  # unknown
    ctypes.windll = types.SimpleNamespace(kernel32=kernel)
    subprocess.CREATE_NEW_PROCESS_GROUP = 0x200
    socket.fromshare = lambda share: socket.socket(fileno=int(share))
    sys.platform = "win32"
