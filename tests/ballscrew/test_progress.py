"""How far a command is: one line in a terminal, nothing where standard error is none."""

import subprocess
import sys
from pathlib import Path

import pytest
from terminal import in_terminal

BALLSCREW = str(Path(sys.executable).with_name("ballscrew"))
COMMANDS = {
    "run": "run --controller pid --stop 4",
    "swap": "swap --controllers pid nctf --stop 2",
    "rig": "rig 2.4/7",
    "map": "map --controller pid --x plant.Fc=0.5:2:8 --y plant.Fs=2.1:3:16 --stop 2 --workers 1",
}
SHOWN = {
    "run": (" of 4 s, ", " left"),
    "swap": ("pid: ", "nctf: ", " of 2 s, ", " left"),
    "rig": ("t = ", " s, ", " left"),
    "map": (" of 128 cells, ", " left"),
}


@pytest.mark.ci
@pytest.mark.parametrize("name", COMMANDS)
def test_a_terminal_has_one_line_that_says_how_far_it_is_and_a_pipe_has_none(name, tmp_path):
    command = [BALLSCREW, *COMMANDS[name].split(), "--out", str(tmp_path)]
    code, said = in_terminal(command)
    assert code == 0
    assert [part for part in SHOWN[name] if part not in said] == []
    assert "\n" not in said
    assert max(map(len, said.split("\r"))) <= 100
    *_, before, last = said.split("\r")
    assert (before.strip(), last) == ("", "")
    if name == "run":
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        assert done.stderr == ""
