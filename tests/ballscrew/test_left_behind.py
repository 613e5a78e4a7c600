"""What killed commands left is removed by the next one; a full disk is told with its file."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from waiting import wait_for

from ballscrew.solver import files

pytestmark = pytest.mark.ci

BALLSCREW = Path(sys.executable).with_name("ballscrew")
LONG = ["run", "--controller", "nctf", "--stop", "4000"]


def begin(temporary, out):
    """A long command, and its folder for temporary files."""
    before = set(temporary.iterdir())
    process = subprocess.Popen(
        [BALLSCREW, *LONG, "--isolate", "--out", out],
        env=os.environ | {"TMPDIR": str(temporary)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def unpacked():
        return [f for f in set(temporary.iterdir()) - before if f.is_dir() and list(f.iterdir())]

    return process, wait_for(unpacked, 60.0, process)[0]


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


def test_what_cannot_be_written_to_a_full_disk_is_told_with_its_file(tmp_path, monkeypatch):
    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match=str(tmp_path / "file")) as caught:
        files.write_atomically(tmp_path / "file", b"data")
    assert caught.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []
