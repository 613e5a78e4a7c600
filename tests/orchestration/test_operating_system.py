"""What is asked of the operating system stands in one module, and has a branch for Windows."""

import ast
import ctypes
import errno
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest

import ballscrew
from ballscrew.orchestration import memory, operating_system
from ballscrew.solver import files

INSTALLED = Path(ballscrew.__file__).parent
SUPPORT = Path(__file__).parents[1] / "support"
MODULES = {"fcntl", "resource", "prctl", "signal", "select", "msvcrt", "posix", "pty", "termios"}
OF_OS = "fork forkpty kill killpg memfd_create pread pwrite setpgid setsid sched_ wait waitpid"
HOW = {"creationflags", "pass_fds", "preexec_fn", "process_group", "start_new_session"}


def asked_of_the_system(text):
    """Lines of a source that ask the system what only `operating_system` may."""
    found = []
    for node in ast.walk(ast.parse(text)):
        names = set()
        if isinstance(node, ast.Import):
            names = {a.name.partition(".")[0] for a in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = {node.module} & MODULES
            if node.module == "os":
                names = {a.name for a in node.names} & set(OF_OS.split())
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "os" and node.attr in OF_OS.split():
                names = {node.attr}
        elif isinstance(node, ast.Call):
            names = {k.arg for k in node.keywords} & HOW
        found += [f"{node.lineno}: {', '.join(sorted(names))}"] if names else []
    return found


def test_nothing_else_in_the_package_asks_for_signals_processes_locks_or_limits():
    modules = {p.relative_to(INSTALLED).as_posix(): p for p in INSTALLED.rglob("*.py")}
    assert len(modules) > 300
    found = {name: asked_of_the_system(p.read_text("utf-8")) for name, p in modules.items()}
    assert {name for name, lines in found.items() if lines} == {"orchestration/operating_system.py"}
    assert len(found["orchestration/operating_system.py"]) > 10


@pytest.mark.parametrize(
    "line",
    [
        "import fcntl",
        "from resource import getrlimit",
        "import os\nos.killpg(1, 9)",
        "from os import fork",
        "subprocess.run([], preexec_fn=print)",
    ],
)
def test_the_reader_of_sources_sees_each_way_of_asking(line):
    assert asked_of_the_system(line)


def test_files_are_renamed_in_one_place():
    """But for the scratch folder of a command (`supervision.py`), which only Linux has."""
    users = {
        p.relative_to(INSTALLED).as_posix()
        for p in INSTALLED.rglob("*.py")
        if "os.replace(" in (text := p.read_text("utf-8")) or "os.rename(" in text
    }
    assert users == {"solver/files.py", "supervision.py"}


def run(code, *arguments, **environment):
    """Run code in a fresh interpreter that finds `as_on_windows`; what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        timeout=300,
        env=os.environ | {"PYTHONPATH": str(SUPPORT), "PYTHONSAFEPATH": "1"} | environment,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


IMPORT_ALL = """
import as_on_windows, pkgutil, importlib
as_on_windows.look_like_windows()
import ballscrew
names = [m.name for m in pkgutil.walk_packages(ballscrew.__path__, "ballscrew.")]
for name in names:
    importlib.import_module(name)
import os, signal
assert not hasattr(os, "fork") and not hasattr(signal, "pthread_sigmask")
print(len(names))
"""


def test_every_module_is_imported_on_a_system_like_windows():
    assert int(run(IMPORT_ALL)) > 300


COMMAND = """
import as_on_windows, sys
as_on_windows.look_like_windows()
sys.path.insert(0, sys.argv.pop(1))
import os, ballscrew
assert ballscrew.__file__.startswith(sys.path[0]), ballscrew.__file__
from ballscrew.__main__ import main
code = main()
print(code)
"""


@pytest.fixture(scope="module")
def with_dlls(tmp_path_factory):
    """The installed package, its libraries named as on Windows; here they stay what they are."""
    folder = tmp_path_factory.mktemp("windows")
    shutil.copytree(INSTALLED, folder / "ballscrew", ignore=shutil.ignore_patterns("__pycache__"))
    libraries = sorted(folder.rglob("c/lib*.so"))
    assert len(libraries) == 3
    for path in libraries:
        path.rename(path.with_suffix(".dll"))
    return folder


def test_runs_and_exports_work_where_all_that_windows_lacks_is_gone(with_dlls, tmp_path):
    out = tmp_path / "out"
    cache = {"BALLSCREW_CACHE": str(tmp_path / "cache")}
    for _ in range(2):  # the second time, the results of the first have to make way
        said = run(
            COMMAND, with_dlls, *f"run --controller pid --stop 0.02 --out {out}".split(), **cache
        )
        assert said.splitlines()[-1] == "0"
    assert (out / "trajectory.csv").is_file()
    assert (out / ".ballscrew" / ".lock").is_file()
    said = run(COMMAND, with_dlls, *f"export --only pid --out {out}/fmus".split(), **cache)
    assert said.splitlines()[-1] == "0"
    assert (out / "fmus" / "pid.fmu").is_file()


INTERRUPTED = """
import as_on_windows, sys
as_on_windows.look_like_windows()
from ballscrew import cli, supervision
def asked(arguments):
    supervision.tell("half of it")
    raise KeyboardInterrupt
class Refusing:
    parse_args = staticmethod(asked)
cli.command_parser = Refusing
print(supervision.supervised(cli.main))
"""


def test_an_interrupt_is_told_where_there_is_no_child_process():
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED],
        capture_output=True,
        encoding="utf-8",
        env=os.environ | {"PYTHONPATH": str(SUPPORT), "PYTHONSAFEPATH": "1"},
    )
    assert done.stdout.split() == ["130"]
    assert "half of it; nothing was written" in done.stderr


@pytest.fixture
def windows(monkeypatch):
    """What is patched with it is as before when the test ends."""
    with monkeypatch.context() as patch:
        yield patch


def test_a_lock_that_is_taken_is_waited_for_on_windows(tmp_path, windows):
    calls = []

    def locking(descriptor, mode, size):
        calls.append((mode, size))
        if len(calls) < 3:
            raise PermissionError(errno.EACCES, "taken")

    fake = types.SimpleNamespace(LK_NBLCK=2, locking=locking)
    windows.setitem(sys.modules, "msvcrt", fake)
    windows.setattr(sys, "platform", "win32")
    with operating_system.locked(tmp_path):
        assert calls == [(2, 1)] * 3
    assert [p.name for p in tmp_path.iterdir()] == [".lock"]


def test_a_lock_is_waited_for_here(tmp_path):
    first = operating_system.lock(tmp_path)
    heard = []
    other = threading.Thread(target=lambda: heard.append(os.close(operating_system.lock(tmp_path))))
    other.start()
    time.sleep(0.2)
    assert not heard
    os.close(first)
    other.join(10)
    assert heard == [None]


ECHO = """
def main(connection):
    while data := connection.recv(100):
        connection.sendall(data.upper())
"""


def test_a_host_talks_and_ends_as_it_would_on_windows(tmp_path, windows):
    (tmp_path / "echo.py").write_text(ECHO, encoding="utf-8")
    pretend = (
        "import sys, socket; sys.platform = 'win32'; "
        "socket.fromshare = lambda share: socket.socket(fileno=int(share)); "
    )
    asked, real = [], subprocess.Popen

    def popen(command, creationflags=0, **how):
        asked.append(creationflags)
        # inherited as they are here: what Windows hands over in the shared text
        how["close_fds"] = False
        return real([*command[:-1], pretend + command[-1]], **how)

    def share(self, process):
        return str(self.fileno()).encode()

    socketpair = socket.socketpair

    def inheritable():
        pair = socketpair()
        pair[1].set_inheritable(True)
        return pair

    windows.setattr(subprocess, "Popen", popen)
    windows.setattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0x200, raising=False)
    windows.setattr(socket.socket, "share", share, raising=False)
    windows.setattr(socket, "socketpair", inheritable)
    windows.setenv("PYTHONPATH", str(tmp_path))
    windows.setattr(sys, "platform", "win32")
    reading, prints = os.pipe()
    connection, process, held = operating_system.start_host("echo", tmp_path, prints)
    connection.settimeout(30)
    connection.sendall(b"hello")
    heard = connection.recv(100)
    assert heard == b"HELLO", os.read(reading, 4096)
    assert asked == [0x200]
    assert process.poll() is None
    held.close()
    assert process.wait(10) == 1  # ended by its thread, with the connection still open
    connection.close()
    os.close(reading)


def test_a_host_is_ended_with_its_children_on_windows(windows):
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    asked = []
    windows.setattr(subprocess, "run", lambda command, **_: asked.append(command))
    windows.setattr(sys, "platform", "win32")
    operating_system.end_host(process)
    assert asked == [["taskkill", "/F", "/T", "/PID", str(process.pid)]]
    assert process.returncode is not None


WITH_PARENT = """
import multiprocessing, sys, time, types
from ballscrew.orchestration import operating_system
parent = types.SimpleNamespace(join=lambda: time.sleep(0.2), sentinel=None)
multiprocessing.parent_process = lambda: parent
sys.platform = sys.argv[1]
operating_system._end_with_parent()
time.sleep(60)
"""


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_a_worker_ends_with_its_parent_on_other_systems(system):
    started = time.monotonic()
    done = subprocess.run([sys.executable, "-c", WITH_PARENT, system])
    assert done.returncode == 1
    assert time.monotonic() - started < 30


def test_a_file_that_is_read_just_now_is_replaced_a_moment_later_on_windows(tmp_path, windows):
    calls, real = [], os.replace

    def replace(source, target):
        calls.append(target)
        if len(calls) < 3:
            raise PermissionError(errno.EACCES, "open elsewhere")
        real(source, target)

    windows.setattr(os, "replace", replace)
    with pytest.raises(PermissionError):
        files.write_atomically(tmp_path / "a", b"here")
    assert len(calls) == 1
    windows.setattr(sys, "platform", "win32")
    files.write_atomically(tmp_path / "a", b"there")
    assert (tmp_path / "a").read_bytes() == b"there"
    windows.setattr(files, "_PATIENCE", 0.1)
    windows.setattr(os, "replace", lambda *_: calls.clear() or replace(*_))
    with pytest.raises(PermissionError):
        files.write_atomically(tmp_path / "a", b"never")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_windows_is_asked_for_its_free_memory(windows):
    def ask(pointer):
        status = pointer._obj
        assert status.length == ctypes.sizeof(status) == 64
        status.free, status.free_pages = 5 * 10**9, 3 * 10**9
        return 1

    kernel = types.SimpleNamespace(GlobalMemoryStatusEx=ask)
    windows.setattr(ctypes, "windll", types.SimpleNamespace(kernel32=kernel), raising=False)
    windows.setattr(memory, "_lines", lambda path: [])
    windows.setattr(sys, "platform", "win32")
    assert memory.available_memory() == 3 * 10**9
    windows.setattr(kernel, "GlobalMemoryStatusEx", lambda pointer: 0)
    assert memory.available_memory() is None


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (3, "ended with exit code 3"),
        (-signal.SIGSEGV, "was ended by SIGSEGV"),
        (-200, "was ended by signal 200"),
        (0xC0000005, "was ended by exception 0xc0000005"),
    ],
)
def test_exit_codes_of_both_systems_are_put_into_words(code, said):
    assert operating_system.how_ended(code) == said
