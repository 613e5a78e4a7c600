"""``ballscrew new``: what it writes works, and nothing is overwritten."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from ballscrew.cli import command_parser, main


def test_the_template_s_own_test_passes_and_the_commands_that_are_told_work(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "controller", "mine", "--out", "my own"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "my own/mine.py and my own/test_mine.py are written. Next:"
    first, test, last = (shlex.split(line) for line in told[1:])
    assert main([*first[1:], "--stop", "0.1", "--step", "1e-3"]) == 0
    assert main(last[1:]) == 0
    assert Path("fmus/mine.fmu").is_file()
    assert command_parser().parse_args(first[1:]).out == Path("out/mine")
    assert test == ["pytest", "my own/test_mine.py"]
    ran = subprocess.run(
        [sys.executable, "-m", *test, "-q", "-p", "no:cacheprovider"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout
    assert "1 passed" in ran.stdout


@pytest.mark.ci
@pytest.mark.parametrize("there", ["mine.py", "test_mine.py"])
def test_nothing_is_overwritten(tmp_path, monkeypatch, capsys, there):
    monkeypatch.chdir(tmp_path)
    Path(there).write_text("mine\n", encoding="utf-8")
    assert main(["new", "controller", "mine"]) == 2
    heard = capsys.readouterr().err
    assert heard == f"ballscrew: {there} exists already; choose another NAME or --out\n"
    assert [p.name for p in tmp_path.iterdir()] == [there]
    assert Path(there).read_text(encoding="utf-8") == "mine\n"
