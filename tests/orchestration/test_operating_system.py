"""What is asked of the operating system has a branch for Windows."""

import errno
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from ballscrew.orchestration import operating_system
from ballscrew.solver import files

pytestmark = pytest.mark.ci

SUPPORT = Path(__file__).parents[1] / "support"
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
    environment = os.environ | {"PYTHONPATH": str(SUPPORT), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-c", IMPORT_ALL]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(done.stdout) > 300


@pytest.fixture
def windows(monkeypatch):
    """What is patched with it is as before when the test ends."""
    with monkeypatch.context() as patch:
        yield patch


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
