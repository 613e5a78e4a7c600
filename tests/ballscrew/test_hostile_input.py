"""Odd and hostile requests: each gets one clear line and exit code two, never a traceback."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import main

RUN = ["run", "--controller", "pid", "--stop", "0.1", "--out", "OUT"]
MAP = ["map", "--controller", "pid", "--x", "Kp=100:500:2", "--y", "Kd=20:40:2", "--stop", "0.1"]
MAP += ["--workers", "1", "--out", "OUT"]
LONG, DIGITS = "a" * 256, "1" * 400
PARAMETERS = "[plant]\nm = "


def refused(capsys, arguments, message):
    """The one line that a request gets."""
    assert main(list(map(str, arguments))) == 2
    heard = capsys.readouterr().err
    assert message in heard, heard
    assert heard.count("\n") == 1
    return heard


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder, as the present one, with files that are meant badly."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "long.csv").write_text(f"time,x_d\n0,0\n1,{'1' * 131_073}\n")
    (tmp_path / "long_record.csv").write_text(f"time,u,x\n0,0,0\n1,{'1' * 131_073},0\n")
    (tmp_path / "twice.csv").write_text("time,x_d,x_d\n0,0,1\n1,1,2\n")
    (tmp_path / "deep.toml").write_text(f"a = {'[' * 5000}{']' * 5000}\n")
    (tmp_path / "digits.toml").write_text(f"{PARAMETERS}{DIGITS}\n")
    (tmp_path / "hexadecimal.toml").write_text(f"{PARAMETERS}0x{'f' * 5000}\n")
    (tmp_path / "more_digits.toml").write_text(f"{PARAMETERS}{'1' * 5000}\n")
    (tmp_path / "deep.json").write_text("[" * 100_000)
    value = f'{{"identified": true, "value": {DIGITS}}}'
    (tmp_path / "digits.json").write_text(f'{{"law": "dahl", "parameters": {{"Fc": {value}}}}}')
    (tmp_path / "infinite.json").write_text(
        '{"law": "dahl", "parameters": {"Fc": {"identified": true, "value": 1e999}}}'
    )
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "rig").mkdir()
    rows = "".join(f"{k / 100},0,0\n" for k in range(50))
    (tmp_path / "rig" / "record.csv").write_text(f"time,force,x\n{rows}")
    (tmp_path / "rig" / "trial.json").write_text(f'{{"parameters": {{"plant.m": {DIGITS}}}}}')
    (tmp_path / "record.csv").write_text("time,u,x\n0,0,0\n0.1,0,0\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*RUN, "--setpoint", "-inf"], "--setpoint is -inf, expected a finite number"),
        ([*RUN, "--setpoint", "-3e-2m"], "--setpoint is '-3e-2m', expected a number"),
        ([*RUN, "--limit-voltage", "-3e1"], "--limit-voltage is -3e1, expected more than 0"),
        ([*RUN, "--step", "-1e-3"], "--step is -1e-3 s, expected more than 0"),
        ([*RUN, "--set", f"plant.m={DIGITS}"], "expected a finite number"),
        ([*RUN, "--set", "plant.m=1", "--set", "plant.m=2"], "plant.m is given as 1 and as 2"),
        ([*RUN, "--set", "plant.voltage_limit=9", "--limit-voltage", "8"], "expected one of them"),
        ([*RUN, "--reference", "long.csv"], "values that are not finite"),
        ([*RUN, "--reference", "twice.csv"], "the column 'x_d' occurs twice"),
        ([*RUN, "--reference", LONG], "cannot be read"),
        ([*RUN, "--plant", LONG], "neither one of plant"),
        ([*RUN, "--plant", f"{LONG}.fmu"], "File name too long"),
        ([*RUN, "--coupling", "monolithic", "--isolate"], "--isolate is for FMUs"),
        ([*RUN, "--coupling", "monolithic", "--time-limit", "5"], "--time-limit is for FMUs"),
        (
            [*RUN, "--no-isolate", "--time-limit", "5"],
            "--time-limit is for FMUs in their own process",
        ),
        (["run", "--controller", LONG, "--out", "OUT"], "neither one of iol"),
        (["run", "--system", f"{LONG}.ssp", "--out", "OUT"], "File name too long"),
        ([*RUN[:-1], LONG], "cannot be made: File name too long"),
        ([*RUN[:-1], ""], "--out: is empty; expected a folder"),
        (["swap", "--controllers", "pid", "pid", "--out", "OUT"], "has pid twice"),
        (["export", "--out", "OUT", "--tangents", "3"], "needs --variational"),
        (["lyapunov", "--controller", "pid", "--step", "1", "--out", "OUT"], "is for --via fmu"),
        (
            [
                "lyapunov",
                "--controller",
                "pid",
                "--via",
                "fmu",
                "--tolerance",
                "1e-8",
                "--out",
                "OUT",
            ],
            "--tolerance is for --via model",
        ),
        (
            ["lyapunov", "--controller", "pid", "--via", "fmu", "--step", "1e-320", "--out", "OUT"],
            "use a larger one",
        ),
        (["lyapunov", "--controller", "pid", "--stop", "1e-320", "--out", "OUT"], "at least 1e-09"),
        ([*RUN[:3], "--stop", "1e-320", "--step", "1e-320", "--out", "OUT"], "at least 1e-09"),
        (["rig", "--list", "--out", "OUT"], "--list and --out: expected one of them"),
        (["rig", "--list", "2.4/7"], "--list and a TRIAL"),
        (["rig", "2.4/7", "--seed", "9" * 5000, "--out", "OUT"], "of at most 40 digits"),
        (["rig", "2.4/7", "--set", "plant.m=1", "--set", "plant.m=1", "--out", "OUT"], "as 1 and"),
        ([*MAP, "--resume"], "OUT contains no map to continue"),
        ([*MAP, "--set", "controller.Kp=3"], "Kp is given as a value and as an axis"),
        ([*MAP[:4], "setpoint=0:1:3", *MAP[5:], "--setpoint", "-1e-2"], "an axis of set-points"),
        ([*MAP, "--workers", DIGITS], "expected a whole number from 1 to 1000"),
        (["identify", "long_record.csv", "--law", "dahl", "--out", "OUT"], "no column 'force'"),
        (["identify", f"{LONG}.csv", "--law", "dahl", "--out", "OUT"], "File name too long"),
        (["diagnose", "record.csv", "--params", "deep.toml", "--out", "OUT"], "nested too deeply"),
        (["diagnose", "record.csv", "--params", "digits.toml", "--out", "OUT"], "beyond 1e308"),
        (["diagnose", "record.csv", "--params", "hexadecimal.toml", "--out", "OUT"], "beyond 1e"),
        (["diagnose", "record.csv", "--params", "more_digits.toml", "--out", "OUT"], "not a TOML"),
        (["diagnose", "record.csv", "--params", LONG, "--out", "OUT"], "File name too long"),
        (["identify", "rig", "--law", "dahl", "--out", "OUT"], "expected `plant.m` to be a finite"),
        (["diagnose", "loop", "--out", "OUT"], "symbolic links"),
        (["compare", "loop", "--params", "deep.toml", "--out", "OUT"], "nested too deeply"),
        (["compare", "record.csv", "--params", "loop"], "symbolic links"),
        (["diagnose", "record.csv", "--params", "loop", "--out", "OUT"], "symbolic links"),
        ([*RUN, "--params", "loop"], "symbolic links"),
    ],
)
def test_odd_requests_get_one_line_and_exit_code_two(folder, capsys, arguments, message):
    before = sorted(p.name for p in folder.iterdir())
    refused(capsys, arguments, message)
    left = sorted(p.name for p in folder.iterdir())
    assert [name for name in left if name not in (*before, "OUT")] == []


def test_a_negative_number_with_an_exponent_is_a_value(folder, capsys):
    assert main([*RUN, "--json", "--setpoint", "-3e-2"]) == 0
    assert json.loads(capsys.readouterr().out)["steady_state_error"] < 0


def test_a_reference_may_begin_with_a_byte_order_mark(folder):
    (folder / "excel.csv").write_text("time,x_d\n0,0.01\n1,0.01\n", encoding="utf-8-sig")
    assert main([*RUN, "--reference", "excel.csv"]) == 0


def test_a_reference_may_be_a_file_of_another_format(folder):
    np.savez(folder / "there.npz", time=[0.0, 1.0], x_d=[0.01, 0.01])
    assert main([*RUN, "--reference", "there.npz"]) == 0


def test_no_dask_scheduler_at_an_address_is_one_line_and_soon(folder, capsys):
    heard = refused(capsys, [*MAP[:-4], "--dask", "foo", "--out", "OUT"], "responds at foo")
    assert "missing port" in heard
    asked = [*MAP[:-4], "--dask", "tcp://127.0.0.1:1", "--out", "OUT"]
    refused(capsys, asked, "Connection refused")


def test_a_map_whose_chunk_lost_its_end_computes_it_again(folder, capsys, monkeypatch):
    from ballscrew.stability import stability_map

    with monkeypatch.context() as patch:
        patch.setattr(stability_map, "merge_chunks", lambda *_: 1 / 0)
        assert main(MAP) == 70  # just before the end
    assert "error in ballscrew itself" in capsys.readouterr().err
    (first, *_) = sorted((folder / "OUT" / "map.parts").glob("c0-*.json"))
    first.write_bytes(first.read_bytes()[:-50])
    assert main([*MAP, "--resume"]) == 0
    table = folder / "OUT" / "map.parquet"
    table.write_bytes(table.read_bytes()[:-50])
    refused(capsys, [*MAP, "--resume", "--refine"], "is damaged")


def command(*arguments, **variables):
    """The command in a process of its own, as it was installed."""
    return subprocess.run(
        [sys.executable, "-m", "ballscrew", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
        env={**os.environ, **variables},
    )


def test_a_full_disk_behind_the_output_is_one_line(tmp_path):
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "ballscrew", "rig", "--list"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tempfile.gettempdir(),
        )
    assert done.returncode == 2
    assert done.stderr == "ballscrew: output cannot be written: No space left on device\n"


def test_a_file_whose_name_the_locale_does_not_know_runs(tmp_path, fmus):
    theirs = tmp_path / "ü.fmu"
    theirs.write_bytes(Path(fmus["pid"]).read_bytes())
    plain = {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    run = ["swap", "--controllers", os.fsdecode(os.fsencode(theirs)), "--stop", "0.1"]
    done = command(*run, "--no-isolate", "--out", tmp_path / "out", **plain)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "out" / "comparison.csv").read_text(encoding="utf-8")
    assert text.splitlines()[1].startswith("ü,")


def test_settings_of_the_libraries_below_end_in_no_traceback(tmp_path):
    run = ["run", "--controller", "pid", "--stop", "0.1", "--out", tmp_path]
    done = command(*run, MPLBACKEND="foo")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "phase.png").exists()


def test_a_peak_beyond_the_nominal_amplifier_is_told(folder, capsys):
    asked = [*RUN, "--set", "controller.Kp=5000", "--json"]
    assert main(asked) in (0, 1)
    heard = capsys.readouterr()
    (note,) = json.loads(heard.out)["notes"]
    assert "more than the 36 V of the nominal amplifier, and this run has no limit" in note
    assert "with --limit-voltage 36 the motor would get at most 36 V" in note
    assert note in heard.err
    main([*asked, "--limit-voltage", "36"])
    assert json.loads(capsys.readouterr().out)["notes"] == []


def test_the_advice_names_no_coupling_that_the_run_has(folder, capsys):
    asked = ["run", "--controller", "pid", "--stop", "3", "--step", "0.3", "--out", "OUT"]
    assert main([*asked, "--coupling", "tangent"]) == 1
    heard = capsys.readouterr().err
    assert "use a smaller --step; this run" in heard
