"""An interrupt ends every command at once, with one line, and never looks like a result.

Here each long command is interrupted at one instant; `proofs/interrupts.py` does it at 20.
"""

import signal
import subprocess
import time

import numpy as np
import pytest
from long_commands import BALLSCREW, COMMANDS, Command, interrupted, seen_in, write_data
from waiting import wait_for

from ballscrew.orchestration.run_folder import HIDDEN, written_files

LATEST = 2.0  # s of processor time: well into the work of each


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_data(folder)
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_an_interrupt_ends_a_command_within_two_seconds_with_one_line(name, data, tmp_path):
    number = list(COMMANDS).index(name)
    random = np.random.default_rng([9, number])
    (tmp_path / "notes.txt").write_text("mine")
    command = Command(name, data, tmp_path)
    command.wait_until_busy(random.uniform(0.0, LATEST))
    asked = (signal.SIGINT, signal.SIGTERM)[number % 2]
    assert interrupted(command, asked).fault() == ""
    assert seen_in(tmp_path) == {"notes.txt": b"mine"}


def test_a_command_that_already_waits_for_interrupts_is_seen_to_answer(data, tmp_path):
    command = Command("lyapunov", data, tmp_path)
    wait_for(lambda: sum(command.processes().values()) > LATEST, 60.0, command.process)
    command.wait_until_it_answers()
    assert interrupted(command, signal.SIGINT).fault() == ""


def test_an_interrupt_says_how_far_the_run_was(data, tmp_path):
    command = Command("run", data, tmp_path)
    command.wait_until_busy(3.0)
    said = interrupted(command, signal.SIGINT).said
    assert " of 4000 s; nothing of this run is kept in " in said


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


def test_exit_codes_and_output_are_those_of_the_command():
    asked = subprocess.run([str(BALLSCREW), "--version"], capture_output=True, text=True)
    assert asked.returncode == 0
    assert asked.stdout.startswith("ballscrew ")
    refused = subprocess.run([str(BALLSCREW), "run"], capture_output=True, text=True)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1


def test_a_command_that_a_shell_started_in_the_background_does_not_hear_ctrl_c(data, tmp_path):
    ignoring = f"trap '' INT; exec {BALLSCREW} rig 2.4/1 --out {tmp_path}"
    process = subprocess.Popen(["sh", "-c", ignoring], stdout=subprocess.PIPE, text=True)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 0
