"""Processes end with the one that started them, whatever they are doing."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from third_party_fmus import proportional
from waiting import wait_for

PARENT_OF_A_THIRD_PARTY_FMU = """
import sys, time
from ballscrew.orchestration.fmu.isolated import IsolatedInstance
one = IsolatedInstance(sys.argv[1], "one")
one.initialize({}, 1.0)
one.step(0.0, 1.0)
one.reader(["u"])()
"""


def lives(process):
    try:
        return (
            Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
            != "Z"
        )
    except FileNotFoundError:
        return False


def test_a_hanging_fmu_and_what_it_started_end_with_the_master(tmp_path):
    hang = proportional(
        tmp_path,
        "Hang",
        head="import ctypes, os, pathlib, subprocess\n",
        in_step="started = subprocess.Popen(['sleep', '300'])\n"
        f"        pathlib.Path({str(tmp_path)!r}, 'pids').write_text("
        "f'{os.getpid()} {started.pid} ')\n"
        "        ctypes.PyDLL(None).sleep(300)",
    )
    with subprocess.Popen(
        [sys.executable, "-c", PARENT_OF_A_THIRD_PARTY_FMU, str(hang)], cwd=tmp_path
    ) as master:
        pids = tmp_path / "pids"
        wait_for(lambda: pids.is_file() and pids.read_text().endswith(" "), 60.0, master)
        fmu, started = map(int, pids.read_text().split())
        assert lives(fmu)
        assert lives(started)
        os.kill(master.pid, signal.SIGKILL)
        master.wait(10)
        wait_for(lambda: not lives(fmu) and not lives(started), 5.0)


@pytest.mark.parametrize("how", ["--isolate", pytest.param("--no-isolate", marks=pytest.mark.ci)])
def test_what_an_fmu_has_started_ends_with_the_command(tmp_path, how):
    """Also a child that left its process group."""
    pid = tmp_path / "pid"
    starts = proportional(
        tmp_path,
        "Starts",
        head="import pathlib, subprocess\n",
        in_step=f"path = pathlib.Path({str(pid)!r})\n        if not path.exists():\n"
        "            child = subprocess.Popen(['sleep', '300'], start_new_session=True)\n"
        "            path.write_text(str(child.pid))",
    )
    words = ["run", how, "--controller", starts, "--stop", "0.005", "--step", "1e-3", "--out"]
    command = [sys.executable, "-m", "ballscrew", *words, tmp_path / "out"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert not lives(int(pid.read_text()))
