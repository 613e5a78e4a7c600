"""Exit codes, streams and what a terminal shows: one line each, and no order to the terminal."""

import os
import pty
import select
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest
from third_party_fmus import proportional

from ballscrew import supervision
from ballscrew.cli import main

BALLSCREW = Path(sys.executable).with_name("ballscrew")
RUN = ["run", "--controller", "pid", "--stop", "0.1", "--out", "out"]


def shell(words, folder, **variables):
    """The command with what a shell does to its streams."""
    return subprocess.run(
        ["sh", "-c", f"{BALLSCREW} {words}"],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, **variables},
    )


def rows(folder):
    lines = (folder / "out" / "trajectory.csv").read_text().splitlines()
    assert lines[0].startswith("time,")
    return len(lines)


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError("in two\nlines"),
        pytest.param(TypeError("\ud800"), marks=pytest.mark.ci),
        pytest.param(RecursionError("x" * 5000), marks=pytest.mark.ci),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_of_our_own_is_70_with_one_line_and_a_file_to_report(
    error, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(RUN) == 0
    before = rows(tmp_path)
    capsys.readouterr()
    cache = tmp_path / "cache"
    monkeypatch.setenv("BALLSCREW_CACHE", str(cache))

    def fails(*_):
        raise error

    monkeypatch.setattr("ballscrew.orchestration.loop.closed_loop.run_closed_loop", fails)
    assert main(RUN) == 70
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"ballscrew: this is an error in ballscrew itself; please report {cache}"
    )
    assert type(error).__name__ in line
    assert "test_exit_codes.py, line" in line
    text = (cache / "error.txt").read_text()
    assert "Traceback" in text
    assert "--controller" in text or str(sys.argv) in text
    assert rows(tmp_path) == before  # what was there stays


@pytest.mark.ci
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_streams_cost_no_result_and_nothing_is_written_into_one(closed, tmp_path):
    assert shell(f"{' '.join(RUN)} {closed}", tmp_path).returncode == 0
    assert rows(tmp_path) == 102
    assert shell(f"run --controller no {closed}", tmp_path).returncode == 2


@pytest.mark.ci
def test_an_output_that_cannot_be_written_is_one_line_and_the_results_are_there(tmp_path):
    read, nobody = os.pipe()
    os.close(read)
    full = os.open("/dev/full", os.O_WRONLY)
    for stream, why in ((nobody, "Broken pipe"), (full, "No space left on device")):
        done = subprocess.run(
            [BALLSCREW, *RUN], stdout=stream, stderr=subprocess.PIPE, text=True, cwd=tmp_path
        )
        os.close(stream)
        assert done.returncode == 2
        assert done.stderr == f"ballscrew: output cannot be written: {why}\n"
        assert rows(tmp_path) == 102


@pytest.mark.ci
def test_settings_of_the_libraries_below_and_of_the_locale_change_nothing(tmp_path, fmus):
    """A file's name is written as it is, where the locale does not know its letters."""
    theirs = tmp_path / "ü.fmu"
    theirs.write_bytes(fmus["pid"].read_bytes())
    swap = f"swap --controllers {theirs} --stop 0.1 --no-isolate --out out"
    plain = {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell(swap, tmp_path, MPLBACKEND="foo", **plain)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "out" / "comparison.csv").read_text(encoding="utf-8")
    assert text.splitlines()[1].startswith("ü,")
    assert (tmp_path / "out" / "comparison.png").exists()


@pytest.mark.ci
def test_without_docstrings_and_assertions_commands_work_or_say_why_not(tmp_path):
    optimized = {"PYTHONOPTIMIZE": "2"}
    done = shell("map --help", tmp_path, **optimized)
    assert done.returncode == 0
    assert "usage: ballscrew" in done.stdout
    assert "examples:" in done.stdout
    assert shell(" ".join(RUN), tmp_path, **optimized).returncode == 0
    study = Path(__file__).parents[1] / "data" / "small_study.toml"
    done = shell(f"study {study} --workers 1 --out study", tmp_path, **optimized)
    assert done.returncode == 2
    assert "remove -OO" in done.stderr
    assert len(done.stderr.splitlines()) == 1


# -- no name or message of a file obeys ----------------------------------------------------------


BELL, RED, C1, TURNED = "\x07", "\x1b[31m", "\x9b31m", "\u202e"
SPOOF = f"a{RED}{BELL}{C1}{TURNED}\rb"
OBEYED = {chr(c) for c in (*range(32), *range(127, 160), 0x202E)} - {"\n", "\t"}


def columns(folder):
    rows = "".join(f"{t},0,0\n" for t in np.arange(50) / 100)
    path = folder / "record.csv"
    path.write_text(f"time,{SPOOF.replace(chr(13), '')},u\n{rows}")
    return ["identify", str(path), "--law", "dahl", "--out", str(folder / "out")]


def words_of_an_fmu(folder):
    path = proportional(folder, "Says", at_start=f"raise RuntimeError({SPOOF!r})")
    return ["run", "--controller", str(path), "--out", str(folder / "out")]


def the_name_of_a_file(folder):
    return ["run", "--controller", str(folder / f"{SPOOF}.fmu"), "--out", str(folder / "out")]


@pytest.mark.parametrize(
    "asked",
    [
        words_of_an_fmu,
        *(pytest.param(f, marks=pytest.mark.ci) for f in (columns, the_name_of_a_file)),
    ],
)
def test_what_a_command_prints_holds_no_order_to_the_terminal(asked, tmp_path, capsys):
    main(asked(tmp_path))
    out, said = capsys.readouterr()
    assert "\\x1b[31m" in out + said  # it was named, in letters
    assert not OBEYED & set(out + said)


def test_the_line_of_an_interrupt_holds_none(capsys, monkeypatch):
    monkeypatch.setattr(supervision, "_heard", lambda number: SPOOF.encode() * (number == 0))
    supervision.interrupted()
    said = capsys.readouterr().err
    assert "\\x1b[31m" in said
    assert not OBEYED & set(said)


# -- how far a command is ------------------------------------------------------------------------


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


def in_terminal(words: list[str]) -> tuple[int, str]:
    """The exit code of a command, and what it writes on its standard error, a terminal.

    The terminal has 100 columns. It is kept open here until all is read: when the last process
    closes it, some systems lose what is not read yet.
    """
    ours, theirs = pty.openpty()
    try:
        termios.tcsetwinsize(theirs, (24, 100))
        said = b""
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=theirs) as process:
            ended = False
            while not ended:
                ended = process.poll() is not None  # then what is there now is all
                while select.select([ours], [], [], 0 if ended else 0.05)[0]:
                    said += os.read(ours, 4096)
    finally:
        os.close(ours)
        os.close(theirs)
    return process.returncode, said.decode()


@pytest.mark.ci
@pytest.mark.parametrize("name", COMMANDS)
def test_a_terminal_has_one_line_that_says_how_far_it_is_and_a_pipe_has_none(name, tmp_path):
    command = [str(BALLSCREW), *COMMANDS[name].split(), "--out", str(tmp_path)]
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
