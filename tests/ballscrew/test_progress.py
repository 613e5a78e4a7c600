"""How far a command is: one line in a terminal, nothing where standard error is none."""

import subprocess
import sys

import pytest
from terminal import in_terminal

COMMANDS = {
    "run": ["run", "--controller", "pid", "--stop", "4"],
    "swap": ["swap", "--controllers", "pid", "nctf", "--stop", "2"],
    "rig": ["rig", "2.4/7"],
    "map": (
        "map --controller pid --x plant.Fc=0.5:2:8 --y plant.Fs=2.1:3:16 --stop 2 --workers 1"
    ).split(),
}
SHOWN = {
    "run": (" of 4 s, ", " left"),
    "swap": ("pid: ", "nctf: ", " of 2 s, ", " left"),
    "rig": ("t = ", " s, ", " left"),
    "map": (" of 128 cells, ", " left"),
}


def command(name, folder):
    return [sys.executable, "-m", "ballscrew", *COMMANDS[name], "--out", str(folder / name)]


@pytest.mark.parametrize("name", COMMANDS)
def test_in_a_terminal_one_line_says_how_far_the_command_is_and_is_removed(name, tmp_path):
    code, said = in_terminal(command(name, tmp_path))
    assert code == 0
    assert [part for part in SHOWN[name] if part not in said] == []
    assert "\n" not in said
    assert max(map(len, said.split("\r"))) <= 100
    *_, before, last = said.split("\r")
    assert (before.strip(), last) == ("", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_of_it_is_written_into_a_pipe(name, tmp_path):
    done = subprocess.run(command(name, tmp_path), check=True, capture_output=True, text=True)
    assert done.stderr == ""


def test_without_a_terminal_nothing_is_loaded_for_it():
    ask = (
        "import sys, ballscrew.console as c\n"
        "c.Progress(1.0)(0.5); c.Stages()('reading')\n"
        "print('tqdm' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", ask], check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("False\n", "")
