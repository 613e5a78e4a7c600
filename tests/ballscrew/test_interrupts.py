"""An interrupt ends every command at once, a kill leaves no process, the next one cleans up."""

import errno
import os
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
from ballscrew.solver import files

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
    command = Command(["run", "--controller", "iol", "--stop", "20"], tmp_path, out)
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
    assert process.poll() is None  # else nothing would be shown
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


# -- what killed commands left -------------------------------------------------------------------


def begin(temporary, out):
    """A long command, and its folder for temporary files."""
    before = set(temporary.iterdir())
    process = subprocess.Popen(
        [BALLSCREW, *COMMANDS["run_isolated"].split(), "--out", out],
        env=os.environ | {"TMPDIR": str(temporary)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def unpacked():
        return [f for f in set(temporary.iterdir()) - before if f.is_dir() and list(f.iterdir())]

    return process, wait_for(unpacked, 60.0, process)[0]


@pytest.mark.ci
def test_folders_of_killed_commands_are_removed_and_those_of_living_ones_never(tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    others = [temporary / name for name in ("ballscrew-run-link", "ballscrew-mine", "mine")]
    others[0].symlink_to(tmp_path)
    others[1].mkdir()
    others[2].touch()
    killed, left = begin(temporary, tmp_path / "killed")
    living, used = begin(temporary, tmp_path / "living")
    try:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        held = set(used.rglob("*"))
        deadline = time.monotonic() + 10  # its child ends with it, and frees the folder
        while left.exists():
            assert time.monotonic() < deadline
            assert left.is_dir()
            done = subprocess.run(
                [BALLSCREW, "gallery"],
                env=os.environ | {"TMPDIR": str(temporary)},
                capture_output=True,
            )
            assert done.returncode == 0
        assert held <= set(used.rglob("*"))
        assert held
        assert living.poll() is None
        assert sorted(temporary.iterdir()) == sorted([*others, used])
    finally:
        living.terminate()
        living.wait()
    assert sorted(temporary.iterdir()) == sorted(others)


@pytest.mark.ci
def test_a_folder_that_is_too_deep_for_recursion_goes_with_the_next_command(tmp_path):
    """As an FMU leaves it that makes folders within folders; the path is longer than allowed."""
    place = os.open(tmp_path, os.O_RDONLY)
    for name in ("ballscrew-run-left", *("d" * 9 for _ in range(1200))):
        os.mkdir(name, dir_fd=place)
        inner = os.open(name, os.O_RDONLY, dir_fd=place)
        os.close(place)
        place = inner
    os.close(place)
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run([BALLSCREW, "gallery"], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.ci
def test_what_cannot_be_written_to_a_full_disk_is_told_with_its_file(tmp_path, monkeypatch):
    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match=str(tmp_path / "file")) as caught:
        files.write_atomically(tmp_path / "file", b"data")
    assert caught.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []
