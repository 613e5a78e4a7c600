"""What is asked of the operating system: a branch for Windows, locks, and memory that is left."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from ballscrew.cli import main
from ballscrew.orchestration.fmu import limits, operating_system

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


@pytest.mark.ci
def test_every_module_is_imported_on_a_system_like_windows():
    environment = os.environ | {"PYTHONPATH": str(SUPPORT), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-c", IMPORT_ALL]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(done.stdout) > 250


def test_a_lock_is_waited_for_but_not_that_of_a_folder_that_was_left(tmp_path):
    first = operating_system.lock(tmp_path)
    with pytest.raises(BlockingIOError):
        operating_system.lock(tmp_path, left=True)
    heard = []
    other = threading.Thread(target=lambda: heard.append(os.close(operating_system.lock(tmp_path))))
    other.start()
    time.sleep(0.2)
    assert not heard
    os.close(first)
    other.join(10)
    assert heard == [None]


def test_exit_codes_of_both_systems_are_put_into_words():
    assert operating_system.how_ended(3) == "ended with exit code 3"
    assert operating_system.how_ended(-11) == "was ended by SIGSEGV"
    assert operating_system.how_ended(-200) == "was ended by signal 200"
    assert operating_system.how_ended(0xC0000005) == "was ended by exception 0xc0000005"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run --controller pid --step 1e-6 --stop 50", "5e+07 communication steps need, about"),
        ("map --controller pid --x Kp=1:2:100000 --y Kd=1:2:100000", "100000 x 100000 cells need"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line_that_says_how_much_and_what_to_do(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(limits, "available_memory", lambda: 2 * 10**9)
    assert main([*arguments.split(), "--out", "OUT"]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert "but only 2 GB is available; " in heard
    assert heard.count("\n") == 1
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]
