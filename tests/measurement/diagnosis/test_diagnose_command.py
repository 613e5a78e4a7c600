"""The command: records in; verdict, page and plant out; faults in one line, nothing by halves."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from diagnosed import Diagnosed, run
from pages import Page
from slide_records import write_slide

from ballscrew.orchestration.loop.parameter_file import read_parameters
from ballscrew.orchestration.loop.run_folder import write_run
from ballscrew.orchestration.loop.shown import length

pytestmark = pytest.mark.xdist_group("diagnosis")  # one diagnosis is made once

FILES = {"diagnosis.json", "report.html", "curves.parquet", "parameters.toml", "diagnosis.png"}
PLANT, NEXT = "extended_plant.fmu", "next_experiment.csv"


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """The record of a slide with a ripple, diagnosed by the command."""
    folder = tmp_path_factory.mktemp("diagnosed")
    record, prior_model = write_slide(folder, "torque_ripple")
    given = ("diagnose", record, "--params", prior_model, "--out", folder / "out")
    return Diagnosed(record, prior_model, folder / "out", *run(*given))


def test_a_hidden_ripple_is_named_and_everything_is_written_and_printed(diagnosed):
    result, printed = diagnosed.result, diagnosed.printed
    assert diagnosed.code == 0
    assert {p.name for p in diagnosed.folder.glob("[!.]*")} == {*FILES, PLANT}
    assert (result["verdict"], [c["name"] for c in result["causes"]]) == (
        "explained",
        ["torque_ripple"],
    )
    assert printed.startswith("cause found: torque_ripple (amplitude = ")
    assert printed.count("\n") < 24  # one screen
    for name in ("baseline_residual", "adjusted_residual", "final_residual", "floor"):
        assert f"{result[name]['force_N']:.4g}" in printed
        assert length(result[name]["position_m"]) in printed
    low, high = result["causes"][0]["intervals"]["ripple_cos"]
    assert f"{low:.4g} to {high:.4g}" in printed
    assert "\033" not in diagnosed.said


def test_curves_are_as_long_as_the_record_and_add_up(diagnosed):
    table = pd.read_parquet(diagnosed.folder / "curves.parquet")
    assert len(table) == len(diagnosed.record.read_text().splitlines()) - 1
    assert np.allclose(table["force"], table["predicted"] + table["before"])


def test_the_corrected_file_is_enough_to_compare_all_three_models(diagnosed):
    """On the record that it was made from: the same figures come out."""
    params = diagnosed.folder / "parameters.toml"
    told = read_parameters(params).diagnosis
    assert list(told.causes) == ["torque_ripple"]
    prior = read_parameters(diagnosed.parameters).plant
    assert all(told.prior[n] == v.value for n, v in prior.items())
    code, printed, _ = run("compare", diagnosed.record, "--params", params, "--json")
    assert code == 0
    prior, adjusted, corrected = (
        json.loads(printed)["models"][n]["all"]["force"]["value_N"]
        for n in ("prior", "adjusted", "corrected")
    )
    baseline, final = (diagnosed.result[n] for n in ("baseline_residual", "final_residual"))
    assert prior == pytest.approx(baseline["force_N"], rel=0.02)
    assert corrected == pytest.approx(final["force_N"], rel=0.05)
    assert corrected < 0.5 * adjusted


def test_structure_that_no_cause_has_gives_exit_code_one_and_no_old_plant_stays(tmp_path):
    record, parameters = write_slide(tmp_path, "a bump")
    out = tmp_path / "out"

    def another_run(folder):
        for name in ("diagnosis.json", PLANT, "parameters.toml"):
            (folder / name).write_text("of another record")

    write_run(out, another_run)
    code, printed, _ = run("diagnose", record, "--params", parameters, "--out", out)
    assert code == 1
    assert printed.startswith("cause not found: The model's force is wrong by ")
    assert "What is left varies with position; no known cause does this." in printed
    assert "no known cause" in Page((out / "report.html").read_text()).said
    assert {p.name for p in out.glob("[!.]*")} == {*FILES, NEXT}
    assert read_parameters(out / "parameters.toml").found == {}
    told = json.loads((out / "diagnosis.json").read_text())["next_experiment"]["motion"]
    assert told["says"] in printed
    asked = np.loadtxt(out / NEXT, delimiter=",", skiprows=1)
    x = np.loadtxt(record, delimiter=",", skiprows=1, usecols=2)
    assert asked[-1, 0] == pytest.approx(told["duration_s"])
    assert x.min() <= asked[:, 1].min() < asked[:, 1].max() <= x.max()


@pytest.mark.ci
def test_a_cause_is_built_in_that_the_user_takes(diagnosed, tmp_path):
    given = ("--params", diagnosed.parameters, "--out", tmp_path)
    code, printed, _ = run("diagnose", diagnosed.record, *given, "--take", "friction_drift")
    told = json.loads((tmp_path / "diagnosis.json").read_text())
    assert "friction_drift" in [c["name"] for c in told["causes"]]
    assert (tmp_path / PLANT).is_file()
    assert "friction_drift (" in printed
    assert code in (0, 1)


def bad(*arguments):
    """What the command says of a request that makes no sense."""
    code, printed, said = run("diagnose", *arguments)
    assert code == 2
    assert printed == ""
    assert said.startswith("ballscrew: ")
    assert said.count("\n") == 1
    return said


@pytest.mark.ci
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "the following arguments are required: DATA"),
        (("no.csv",), "no such file"),
        (("RECORD", "--map", "u"), "THEIRS=OURS"),
        (("RECORD", "--map", "volts=u"), "there is no column 'volts'"),
        (("RECORD", "--law", "modified_lugr"), "did you mean modified_lugre?"),
        (("RECORD", "--params", "no.toml"), "cannot be read"),
        (("RECORD", "--params", "RECORD"), "is not a TOML file"),
        (("RECORD", "--params", "PARAMS", "--out", "RECORD"), "is a file, expected a folder"),
        (("RECORD", "--params", "PARAMS", "--out", "DATA"), "would be overwritten"),
        (("RECORD", "--take", "backlsh"), "backlash"),
        (("RECORD", "--params", "PARAMS", "--unit", "x=deg"), "give lead in metres"),
        (("RECORD", "--params", "PARAMS", "--unit", "x=inch"), "expected one of m, cm, mm"),
        (("RECORD", "--lead", "0"), "lead is 0, expected a number of metres above 0"),
        (("RECORD", "--params", "SCREW", "--lead", "0.01"), "the lead is given as 0.01 m, but "),
        (("RECORD", "--params", "SCREW"), "[plant] has no kt (torque constant), and the nominal"),
        (("RECORD",), "u is a force, and the ball_screw is driven by a voltage; say"),
    ],
)
def test_requests_that_make_no_sense_are_one_line(diagnosed, tmp_path, arguments, words):
    named = {"RECORD": diagnosed.record, "PARAMS": tmp_path / "data" / "parameters.toml"}
    named |= {"DATA": tmp_path / "data", "SCREW": tmp_path / "screw.toml"}
    named["DATA"].mkdir()
    believed = diagnosed.parameters.read_bytes()
    named["PARAMS"].write_bytes(believed)
    named["SCREW"].write_text("[plant]\np = 200.0\n")
    out = () if "--out" in arguments else ("--out", tmp_path / "out")
    assert words in bad(*(named.get(a, a) for a in arguments), *out)
    assert named["PARAMS"].read_bytes() == believed
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


U = "u [N]"


@pytest.mark.ci
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t: {**t, "x": 0 * t["x"]}, "the position never changes"),
        (lambda t: {**t, U: 0 * t[U]}, "the command u is zero all the time"),
        (lambda t: {n: v[:100] for n, v in t.items()}, "is too short"),
        (lambda t: {**t, "x": t["x"] + 3e-3 * np.sin(500.0 * t["time"])}, "the axis vibrates"),
        (lambda t: {n: v for n, v in t.items() if n != U}, "has no column 'u'"),
        (lambda t: {**t, "x": 1e4 * t["x"]}, "unit x=mm"),
        (lambda t: {**t, "time": 1e3 * t["time"]}, "unit time=ms"),
        (lambda t: {n: v[::30] * (3.0 if n == "time" else 1.0) for n, v in t.items()}, "too slow"),
    ],
    ids=["no motion", "no command", "too short", "vibrates", "no column", "mm", "ms", "slow"],
)
def test_records_that_carry_no_diagnosis_leave_nothing_behind(diagnosed, tmp_path, spoil, words):
    names, rows = diagnosed.record.read_text().split("\n", 1)
    columns = np.loadtxt(rows.splitlines(), delimiter=",", ndmin=2).T
    table = spoil(dict(zip(names.split(","), columns, strict=True)))
    path, out = tmp_path / "spoilt.csv", tmp_path / "out"
    data = np.column_stack(list(table.values()))
    np.savetxt(path, data, delimiter=",", header=",".join(table), comments="", fmt="%.9g")
    assert words in bad(path, "--params", diagnosed.parameters, "--out", out)
    assert not out.exists()
