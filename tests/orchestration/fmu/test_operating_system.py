"""What is asked of the operating system has a branch for Windows."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from ballscrew.orchestration.fmu import operating_system

pytestmark = pytest.mark.ci

SUPPORT = Path(__file__).parents[2] / "support"
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
