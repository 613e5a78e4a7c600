"""Exit code 1 means that a result is not to be trusted, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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
        ZeroDivisionError(),
        AssertionError("a truth"),
        np.linalg.LinAlgError("Singular matrix"),
        KeyError("name"),
        TypeError("\ud800"),
        RecursionError("x" * 5000),
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

    monkeypatch.setattr("ballscrew.orchestration.run.run_closed_loop", fails)
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


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_cost_no_result_and_nothing_is_written_into_one(closed, tmp_path):
    done = shell(f"{' '.join(RUN)} {closed}", tmp_path)
    assert done.returncode == 0
    assert rows(tmp_path) == 102
    assert shell(f"run --controller no {closed}", tmp_path).returncode == 2


def test_nobody_who_hears_of_a_fault_changes_no_exit_code(tmp_path):
    """A pipe whose reader is gone, for standard error; `--stop 0.01` never settles: no note."""
    for words, code in ((RUN, 0), ([*RUN, "--set", "controller.Kp=1e9"], 1), (["run"], 2)):
        read, write = os.pipe()
        os.close(read)
        done = subprocess.run(
            [BALLSCREW, *words], stdout=subprocess.DEVNULL, stderr=write, cwd=tmp_path
        )
        os.close(write)
        assert done.returncode == code
    assert rows(tmp_path) > 1


def test_an_output_that_nobody_reads_is_one_line_and_the_results_are_there(tmp_path):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [BALLSCREW, *RUN], stdout=write, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )
    os.close(write)
    assert done.returncode == 2
    assert done.stderr == "ballscrew: output cannot be written: Broken pipe\n"
    assert rows(tmp_path) == 102


def test_without_docstrings_and_assertions_commands_work_or_say_why_not(tmp_path):
    optimized = {"PYTHONOPTIMIZE": "2"}
    for command in ("", "run", "map", "study", "diagnose", "compare"):
        done = shell(f"{command} --help", tmp_path, **optimized)
        assert done.returncode == 0
        assert "usage: ballscrew" in done.stdout
        assert "examples:" in done.stdout
    assert shell(" ".join(RUN), tmp_path, **optimized).returncode == 0
    study = Path(__file__).parents[1] / "data" / "small_study.toml"
    done = shell(f"study {study} --workers 1 --out study", tmp_path, **optimized)
    assert done.returncode == 2
    assert "remove -OO" in done.stderr
    assert len(done.stderr.splitlines()) == 1
