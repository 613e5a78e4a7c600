"""``ballscrew diagnose --judge``: scores printed, as JSON, saved; requests that make no sense."""

import json

import numpy as np
import pytest
from axis_records import NOMINAL, friction_noise, moved, signals_of
from diagnosed import run
from worlds import layout as at

from ballscrew.orchestration.parameter_file import Diagnosed, ParameterFile, Value

LOAD = 0.5


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A record with a load, and what a diagnosis of another one left that found the load."""
    folder = tmp_path_factory.mktemp("judged")
    time = np.arange(10_000) * 1e-3
    u = 3.0 * np.sin(4.0 * time) + 1.5 * np.sin(11.0 * time)
    signals = signals_of(moved({at.LOAD: LOAD}, u, friction_noise(1, len(u))), u)
    table = np.column_stack([signals[n] for n in ("time", "u", "x")])
    np.savetxt(folder / "other.csv", table, delimiter=",", header="time,u,x", comments="")
    truth = dict(NOMINAL)
    told = Diagnosed(
        ("one.csv",),
        "voltage",
        0.0,
        "modified_lugre",
        truth,
        truth,
        {"load_bias": {"load": LOAD}},
    )
    ParameterFile(plant={n: Value(v) for n, v in truth.items()}, diagnosis=told).save(folder)
    return folder


def test_scores_are_printed_with_their_intervals(files):
    code, printed, said = run(
        "diagnose", "--judge", files / "other.csv", "--params", files / "parameters.toml"
    )
    assert (code, said) == (0, "")
    lines = printed.splitlines()
    assert "judged by what was diagnosed of one.csv; corrected: values, and load_bias" in lines[0]
    for name in ("force [N]", "reversals", "slow", "fast", "accelerating", "position over 1 s"):
        assert any(line.strip().startswith(name) for line in lines), name
    force = next(line for line in lines if line.startswith("force [N]"))
    assert force.count(" to ") == 3
    assert any(line.startswith("corrected over values adjusted") for line in lines)


def test_json_is_what_is_saved_and_what_is_printed(files, tmp_path):
    given = ("--judge", files / "other.csv", "--params", files / "parameters.toml")
    code, printed, _ = run("diagnose", *given, "--out", tmp_path, "--json")
    assert code == 0
    told = json.loads(printed)
    assert told == json.loads((tmp_path / "judgement.json").read_text())
    assert told["scores"]["prior"]["force"]["value_N"] == pytest.approx(LOAD, rel=0.1)
    (gain,) = (g for g in told["gains"] if (g["model"], g["over"]) == ("corrected", "adjusted"))
    assert gain["force"]["interval"][0] > 0.9


def test_requests_that_make_no_sense_are_one_line(files, tmp_path):
    record, params = files / "other.csv", files / "parameters.toml"
    plain = tmp_path / "plain.toml"
    plain.write_text("[plant]\nm = 1.0\n")
    for arguments, words in (
        ((record, "--judge", record, "--params", params), "DATA and --judge: expected one of"),
        (("--judge", record), "--judge needs --params"),
        (("--judge", record, "--params", plain), "has no table [diagnosis]"),
        (("--judge", tmp_path / "no.csv", "--params", params), "no such file"),
        (("--judge", record, "--params", tmp_path / "no.toml"), "cannot be read"),
        (("--judge", record, "--params", params, "--unit", "u=A"), "u is a current, but the mod"),
        (("--judge", record, "--params", params, "--law", "dahl"), "--law and --judge"),
        ((record, "--params", params), "--out DIR is missing"),
    ):
        code, printed, said = run("diagnose", *arguments)
        assert (code, printed) == (2, ""), arguments
        assert words in said, said
        assert said.count("\n") == 1


def test_the_file_serves_other_commands_as_before(files, tmp_path):
    """The closed loop takes the values, and its own file says nothing of a diagnosis."""
    given = ("--controller", "nctf", "--params", files / "parameters.toml", "--stop", "0.05")
    code, _, said = run("run", *given, "--out", tmp_path)
    assert code == 0, said
    assert "[diagnosis" not in (tmp_path / "parameters.toml").read_text()
