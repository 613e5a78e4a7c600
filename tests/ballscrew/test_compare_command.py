"""``ballscrew compare``: figures printed, as JSON, saved; requests that make no sense."""

import json
import re

import numpy as np
import pytest
from axis_records import NOMINAL, friction_noise, moved, signals_of
from diagnosed import run
from worlds import layout as at

from ballscrew import compare
from ballscrew.orchestration.parameter_file import Diagnosed, ParameterFile, Value

LOAD = 0.5


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A record with a load, and what a diagnosis of another one left that found the load."""
    folder = tmp_path_factory.mktemp("compared")
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


def figures_of(line):
    """Numbers of a line, those in brackets among them."""
    return [float(n) for n in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", line)]


def test_the_first_line_says_it_and_a_table_follows(files):
    record, params = files / "other.csv", files / "parameters.toml"
    code, printed, said = run("compare", record, "--params", params)
    assert (code, said) == (0, "")
    lines = printed.splitlines()
    told = compare(record, params)
    assert lines[0] == f"The corrected {told.says.removeprefix('the corrected ')}."
    assert "diagnosed of one.csv; corrected: values, and load_bias" in lines[2]
    in_all = [line for line in lines if line.startswith("in all")]
    assert [len(figures_of(line)) for line in in_all] == [12, 12]  # three models and the noise
    assert figures_of(in_all[0])[0] == pytest.approx(told.models["prior"]["all"].force.value, 0.01)
    for name in ("reversals", "slow", "fast", "accelerating", "steady", "forwards", "backwards"):
        assert sum(line.strip().startswith(name) for line in lines) == 2, name
    assert any(line.startswith("corrected over adjusted") for line in lines)


def test_a_file_without_a_diagnosis_has_one_model(files, tmp_path):
    plain = tmp_path / "plain.toml"
    plain.write_text("[plant]\n" + "".join(f"{n} = {v!r}\n" for n, v in NOMINAL.items()))
    code, printed, _ = run("compare", files / "other.csv", "--params", plain)
    assert code == 0
    assert printed.startswith("The model leaves 0.5 N rms of a friction of ")
    assert "gain" not in printed
    one = compare(files / "other.csv", plain)
    three = compare(files / "other.csv", files / "parameters.toml")
    assert one.models["model"] == three.models["prior"]


def test_json_and_the_picture_are_saved(files, tmp_path):
    given = ("compare", files / "other.csv", "--params", files / "parameters.toml")
    code, printed, _ = run(*given, "--out", tmp_path, "--json")
    assert code == 0
    told = json.loads(printed)
    assert told == json.loads((tmp_path / "compare.json").read_text())
    assert told["models"]["prior"]["all"]["force"]["value_N"] == pytest.approx(LOAD, rel=0.1)
    (gain,) = (g for g in told["gains"] if (g["model"], g["over"]) == ("corrected", "adjusted"))
    assert gain["force"]["interval"][0] > 0.9
    assert {p.name for p in tmp_path.glob("[!.]*")} == {"compare.json", "compare.png"}


def test_the_picture_has_what_it_says(files):
    figure = compare(files / "other.csv", files / "parameters.toml").plot()
    position, off, force, over_velocity = figure.axes
    for axes in (position, off, force):
        assert axes.get_ylabel().endswith("]")
    assert over_velocity.get_xlabel() == "velocity [mm/s]"
    assert force.get_xlabel() == "time [s]"
    names = [text.get_text() for text in position.get_legend().get_texts()]
    assert names == ["measured", "prior model", "adjusted model", "corrected model"]
    # the load stands between what is required and what the prior model has
    required, prior, _, corrected = (line.get_ydata() for line in force.lines)
    assert np.median(required - prior) == pytest.approx(LOAD, rel=0.1)
    assert abs(np.median(required - corrected)) < 0.1 * LOAD


def test_the_table_for_pandas_has_a_row_for_each_part(files):
    table = compare(files / "other.csv", files / "parameters.toml").to_pandas()
    assert list(table.columns) == ["model", "part", "force_N", "position_m"]
    prior = table[(table.model == "prior") & (table.part == "all")]
    assert prior.force_N.item() == pytest.approx(LOAD, rel=0.1)


def test_requests_that_make_no_sense_are_one_line(files, tmp_path):
    record, params = files / "other.csv", files / "parameters.toml"
    other_kind, controller = tmp_path / "fmu.toml", tmp_path / "unknown.toml"
    other_kind.write_text('kind = "fmu"\n')
    controller.write_text("[plant]\nmass = 1.0\n")
    for arguments, words in (
        (("--params", params), "the following arguments are required: RECORD"),
        ((record,), "the following arguments are required: --params"),
        ((tmp_path / "no.csv", "--params", params), "no such file"),
        ((record, "--params", tmp_path / "no.toml"), "cannot be read"),
        ((record, "--params", other_kind), "kind is 'fmu', expected one of ball_screw, drive"),
        ((record, "--params", controller), "there is no 'mass'"),
        ((record, "--params", params, "--unit", "u=A"), "u is a current, but the mod"),
        ((record, "--params", params, "--unit", "u=N"), "u is a force, but the model"),
        ((record, "--params", params, "--lead", "0.001"), "both give the lead of the screw"),
        ((record, "--params", params, "--out", record), "is a file, expected a folder"),
    ):
        code, printed, said = run("compare", *arguments)
        assert (code, printed) == (2, ""), arguments
        assert words in said, said
        assert said.count("\n") == 1


def test_the_file_serves_other_commands_as_before(files, tmp_path):
    """The closed loop takes the values, and its own file says nothing of a diagnosis."""
    given = ("--controller", "nctf", "--params", files / "parameters.toml", "--stop", "0.05")
    code, _, said = run("run", *given, "--out", tmp_path)
    assert code == 0, said
    assert "[diagnosis" not in (tmp_path / "parameters.toml").read_text()
