"""An interrupt ends every command at once, with one line; a kill leaves no process behind.

Here each long command is interrupted at one instant; `proofs/interrupts.py` does it at 20.
"""

import signal
import subprocess
import time

import numpy as np
import pytest
from long_commands import (
    BALLSCREW,
    COMMANDS,
    WITH_CHILDREN,
    Command,
    interrupted,
    seen_in,
    write_data,
)
from waiting import wait_for

from ballscrew.orchestration.loop.run_folder import HIDDEN, written_files

LATEST = 2.0  # s of processor time: well into the work of each


def of_each_command(shown, *ci):
    """All long commands: one in `make test`, some in CI, the others among the proofs."""
    marks = {name: pytest.mark.ci if name in ci else pytest.mark.prove for name in COMMANDS}
    cases = [pytest.param(name, marks=marks[name]) for name in COMMANDS if name != shown]
    return pytest.mark.parametrize("name", [shown, *cases])


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_data(folder)
    return folder


@of_each_command("run_isolated", "map", "identify")
def test_an_interrupt_ends_a_command_within_two_seconds_with_one_line(name, data, tmp_path):
    number = list(COMMANDS).index(name)
    random = np.random.default_rng([9, number])
    (tmp_path / "notes.txt").write_text("mine")
    command = Command(name, data, tmp_path)
    command.wait_until_busy(random.uniform(0.0, LATEST))
    asked = (signal.SIGINT, signal.SIGTERM)[number % 2]
    assert interrupted(command, asked).fault() == ""
    assert seen_in(tmp_path) == {"notes.txt": b"mine"}


@pytest.mark.ci
def test_an_interrupt_while_pictures_are_drawn_leaves_the_earlier_run(tmp_path):
    out = tmp_path / "out"
    words = [str(BALLSCREW), "run", "--controller", "iol", "--stop", "1", "--out", str(out)]
    subprocess.run(words, check=True, capture_output=True)
    before = seen_in(out)
    assert "trajectory.csv" in before
    command = Command.of(["run", "--controller", "iol", "--stop", "20"], out)
    wait_for((out / HIDDEN / "next").is_dir, 120.0, command.process)
    ending = interrupted(command, signal.SIGTERM)
    assert ending.fault() == ""
    assert ", writing the results; nothing of this run is kept in " in ending.said
    assert seen_in(out) == before
    assert set(written_files(out)) == set(before)
    assert not (out / HIDDEN / "next").exists()


@pytest.mark.ci
def test_a_command_whose_work_dies_says_so_and_keeps_the_folder(data, tmp_path):
    command = Command("lyapunov", data, tmp_path)
    command.wait_until_busy(2.0)
    (worker,) = set(command.processes()) - {command.process.pid}
    subprocess.run(["kill", "-SEGV", str(worker)], check=True)
    _, said = command.process.communicate(timeout=10)
    assert command.process.returncode == 128 + signal.SIGSEGV
    assert said.startswith("ballscrew: ended by SIGSEGV after ")
    assert said.count("\n") == 1
    assert seen_in(tmp_path) == {}


@pytest.mark.ci
def test_a_command_that_a_shell_started_in_the_background_does_not_hear_ctrl_c(data, tmp_path):
    ignoring = f"trap '' INT; exec {BALLSCREW} rig 2.4/1 --out {tmp_path}"
    process = subprocess.Popen(["sh", "-c", ignoring], stdout=subprocess.PIPE, text=True)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 0


@of_each_command("map", "run_isolated", "rig")
def test_five_seconds_after_a_kill_no_process_of_a_command_lives(name, data, tmp_path):
    command = Command(name, data, tmp_path / "out")
    command.wait_until_busy(1.2, children=3 if name in WITH_CHILDREN else 1)
    command.process.send_signal(signal.SIGKILL)
    command.process.communicate(timeout=10)
    assert command.left_after(5.0) == {}
