"""Exit code 1 means that a result is not to be trusted, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

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
    done = shell(f"{' '.join(RUN)} {closed}", tmp_path)
    assert done.returncode == 0
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
