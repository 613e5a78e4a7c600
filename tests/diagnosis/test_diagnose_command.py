"""The command: records in; verdict, page and plant out; faults in one line, nothing by halves."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from axis_records import NOTCH, write_strong
from diagnosed import run

from ballscrew.orchestration.parameter_reading import read_parameters
from ballscrew.orchestration.run_folder import write_run

pytestmark = pytest.mark.xdist_group("diagnosis")  # one diagnosis is made once

FILES = {
    "diagnosis.json",
    "report.html",
    "diagnosis.png",
    "curves.parquet",
    "extended_plant.fmu",
    "parameters.toml",
}


def test_a_hidden_load_is_named_and_everything_is_written(diagnosed):
    assert diagnosed.code == 0
    assert {p.name for p in diagnosed.folder.glob("[!.]*")} == FILES
    assert diagnosed.result["verdict"] == "explained"
    assert [c["name"] for c in diagnosed.result["causes"]] == ["load_bias"]


def test_what_is_printed_says_all_that_matters(diagnosed):
    printed = diagnosed.printed
    result = diagnosed.result
    assert printed.startswith("explained: load_bias explains")
    assert result["where"] in printed
    for name in ("baseline_residual", "adjusted_residual", "final_residual", "floor"):
        assert f"{result[name]['force_N']:.4g}" in printed
        assert f"{1e6 * result[name]['position_m']:.4g}" in printed
    low, high = result["causes"][0]["intervals"]["load"]
    assert f"{low:.4g} .. {high:.4g}" in printed
    assert "closed loop: under nctf" in printed
    assert "\033" not in diagnosed.said


def test_curves_are_as_long_as_the_record_and_add_up(diagnosed):
    table = {n: c.to_numpy() for n, c in zip(*_columns(diagnosed.folder), strict=True)}
    rows = len(diagnosed.record.read_text().splitlines()) - 1
    assert len(table["time"]) == rows
    assert np.allclose(table["force"], table["predicted"] + table["before"])


def _columns(folder):
    table = pq.read_table(folder / "curves.parquet")
    return table.column_names, table.columns


def test_the_extended_plant_runs_in_the_closed_loop(diagnosed, tmp_path):
    plant = diagnosed.folder / "extended_plant.fmu"
    given = ("--controller", "nctf", "--plant", plant, "--stop", "0.05", "--out", tmp_path)
    code, printed, _ = run("run", *given)
    assert code == 0
    assert "trusted" in printed


def test_the_corrected_file_is_enough_to_compare_all_three_models(diagnosed, tmp_path):
    """On the record that it was made from: the same figures come out."""
    params = diagnosed.folder / "parameters.toml"
    told = read_parameters(params).diagnosis
    assert list(told.causes) == ["load_bias"]
    prior = read_parameters(diagnosed.parameters).plant
    assert all(told.prior[n] == v.value for n, v in prior.items())
    code, printed, _ = run("compare", diagnosed.record, "--params", params, "--json")
    assert code == 0
    models = json.loads(printed)["models"]
    baseline, final = (diagnosed.result[n] for n in ("baseline_residual", "final_residual"))
    assert models["prior"]["all"]["force"]["value_N"] == pytest.approx(
        baseline["force_N"], rel=0.02
    )
    assert models["corrected"]["all"]["force"]["value_N"] == pytest.approx(
        final["force_N"], rel=0.05
    )
    assert (
        models["corrected"]["all"]["force"]["value_N"]
        < models["adjusted"]["all"]["force"]["value_N"]
    )


def test_where_nothing_is_hidden_nothing_is_named_and_no_old_plant_stays(tmp_path):
    record, parameters = write_strong({}, tmp_path / "data")
    out = tmp_path / "out"

    def another_run(folder):
        for name in ("diagnosis.json", "extended_plant.fmu", "parameters.toml"):
            (folder / name).write_text("of another record")

    write_run(out, another_run)
    given = ("diagnose", record, "--params", parameters, "--out", out, "--json")
    code, printed, _ = run(*given)
    assert code == 0
    told = json.loads(printed)
    assert told == json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == "none"
    assert told["causes"] == []
    assert not (out / "extended_plant.fmu").exists()
    assert read_parameters(out / "parameters.toml").found == {}
    assert "No cause was named" in (out / "report.html").read_text()


def test_structure_that_no_cause_has_gives_exit_code_one(tmp_path):
    record, parameters = write_strong(NOTCH, tmp_path / "data")
    out = tmp_path / "out"
    code, printed, _ = run("diagnose", record, "--params", parameters, "--out", out)
    assert code == 1
    assert printed.startswith("unexplained: ")
    assert "no cause found: the remaining error varies with position" in printed
    assert "next experiment: " in printed
    assert "  ballscrew rig " in printed
    written = {p.name for p in out.glob("[!.]*")}
    assert written == FILES - {"extended_plant.fmu"} | {"next_experiment.csv"}
    told = json.loads((out / "diagnosis.json").read_text())["next_experiment"]["motion"]
    assert told["says"] in printed
    asked = np.loadtxt(out / "next_experiment.csv", delimiter=",", skiprows=1)
    x = np.loadtxt(record, delimiter=",", skiprows=1, usecols=2)
    assert asked[-1, 0] == pytest.approx(told["duration_s"])
    assert x.min() <= asked[:, 1].min() < asked[:, 1].max() <= x.max()
    assert '"meta": "shape"' in (out / "report.html").read_text()


def bad(*arguments):
    """What the command says of a request that makes no sense."""
    code, printed, said = run("diagnose", *arguments)
    assert code == 2
    assert printed == ""
    assert said.startswith("ballscrew: ")
    assert said.count("\n") == 1
    return said


def test_requests_that_make_no_sense_are_one_line(diagnosed, tmp_path):
    record, params, out = diagnosed.record, diagnosed.parameters, tmp_path / "out"
    given = ("--params", params, "--out", out)
    for arguments, words in (
        (("--out", out), "the following arguments are required: DATA"),
        ((tmp_path / "no.csv", *given), "no such file"),
        ((record, "--map", "u", *given), "THEIRS=OURS"),
        ((record, "--map", "volts=u", *given), "there is no column 'volts'"),
        ((record, "--law", "modified_lugr", *given), "did you mean modified_lugre?"),
        ((record, "--params", tmp_path / "no.toml", "--out", out), "cannot be read"),
        ((record, "--params", record, "--out", out), "is not a TOML file"),
        ((record, "--params", params, "--out", record), "is a file, expected a folder"),
    ):
        assert words in bad(*arguments), arguments
    assert not out.exists() or not list(out.iterdir())


def test_results_do_not_take_the_place_of_what_they_are_made_from(diagnosed, tmp_path):
    mine = tmp_path / "parameters.toml"
    mine.write_bytes(diagnosed.parameters.read_bytes())
    said = bad(diagnosed.record, "--params", mine, "--out", tmp_path)
    assert "would be overwritten" in said
    assert mine.read_bytes() == diagnosed.parameters.read_bytes()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t: {**t, "x": 0 * t["x"]}, "the position never changes"),
        (lambda t: {**t, "u": 0 * t["u"]}, "the command u is zero all the time"),
        (lambda t: {n: v[:100] for n, v in t.items()}, "is too short"),
        (lambda t: {n: v for n, v in t.items() if n not in ("u", "i")}, "has no column 'u'"),
        (lambda t: {**t, "x": 1e4 * t["x"]}, "--unit x=mm"),
        (lambda t: {**t, "time": 1e3 * t["time"]}, "--unit time=ms"),
        (lambda t: {n: v[::50] * (2.0 if n == "time" else 1.0) for n, v in t.items()}, "too slow"),
    ],
    ids=[
        "no motion",
        "no command",
        "too short",
        "no column",
        "another unit",
        "milliseconds",
        "slow",
    ],
)
def test_records_that_carry_no_diagnosis_leave_nothing_behind(diagnosed, tmp_path, spoil, words):
    names, rows = diagnosed.record.read_text().split("\n", 1)
    columns = np.loadtxt(rows.splitlines(), delimiter=",", ndmin=2).T
    table = spoil(dict(zip(names.split(","), columns, strict=True)))
    path, out = tmp_path / "spoilt.csv", tmp_path / "out"
    data = np.column_stack(list(table.values()))
    np.savetxt(path, data, delimiter=",", header=",".join(table), comments="", fmt="%.9g")
    assert words in bad(path, "--params", diagnosed.parameters, "--out", out)
    assert not list(out.iterdir())


DRIVE = 'kind = "drive"\nlaw = "classical"\n[plant]\nm = 2.0\nFc = 1.5\nsigma2 = 20.0\n'


def test_units_and_lead_are_asked_for_in_one_line(diagnosed, tmp_path):
    drive = tmp_path / "drive.toml"
    drive.write_text(DRIVE)
    screw = tmp_path / "screw.toml"
    screw.write_text("[plant]\np = 200.0\n")
    record, out = diagnosed.record, tmp_path / "out"
    for arguments, words in (
        (("--params", drive, "--unit", "x=deg"), "use --lead METRES"),
        (("--params", drive, "--unit", "x=inch"), "expected one of m, cm, mm"),
        (("--params", drive, "--lead", "0"), "--lead is 0, expected a number of metres above 0"),
        (("--params", screw, "--lead", "0.005"), "both give the lead of the screw"),
        (("--params", screw, "--unit", "u=N"), "u is a force, but the ball screw is driven by a"),
    ):
        assert words in bad(record, *arguments, "--out", out), arguments


def test_a_machines_export_is_diagnosed_as_the_same_record_in_si_units(tmp_path):
    """Degrees, a torque in mN*m, milliseconds, decimal commas: the same numbers come out."""
    random = np.random.default_rng(2)
    time = 2e-3 * np.arange(1500)
    v = 0.06 * np.sin(2 * np.pi * 0.8 * time) + 0.02 * np.sin(2 * np.pi * 2.3 * time)
    x = np.cumsum(v) * 2e-3
    force = 2.0 * np.gradient(v, time) + 20.0 * v + 1.5 * np.tanh(v / 1e-4)
    force += 0.05 * random.standard_normal(len(time))
    lead = 0.005
    plain, export = tmp_path / "plain.csv", tmp_path / "export.csv"
    rows = zip(time, force, x, strict=True)
    plain.write_text("time,u,x\n" + "".join(f"{t:.9g},{u:.12g},{w:.12g}\n" for t, u, w in rows))
    lines = ["Axis:;7", "Date:;2024-03-01", ";Torque;Actual position", "ms;mNm;°"]
    for t, u, w in zip(time, force, x, strict=True):
        torque, angle = 1e3 * u * lead / (2 * np.pi), 360 * w / lead
        lines.append(f"{1e3 * t:.9g};{torque:.12g};{angle:.12g};".replace(".", ","))
    export.write_bytes("\r\n".join(lines).encode("latin-1"))
    params = tmp_path / "drive.toml"
    params.write_text(DRIVE + "[tolerance]\nsigma2 = 0\nm = 0\n")
    told = []
    names = ("--map", "1=time", "--map", "Torque=u", "--map", "Actual position=x")
    for file, more in ((plain, ("--unit", "u=N")), (export, (*names, "--lead", lead))):
        code, printed, said = run(
            "diagnose", file, "--params", params, *more, "--out", tmp_path / file.stem, "--json"
        )
        assert code in (0, 1), said
        told.append(json.loads(printed))
    one, other = told
    assert one["verdict"] == other["verdict"]
    assert one["baseline_residual"] == pytest.approx(other["baseline_residual"], rel=1e-3)
    # a tolerance of zero holds a value
    assert "sigma2" not in one["adjustments"]
    assert "m" not in one["adjustments"]
    written = read_parameters(tmp_path / "plain" / "parameters.toml")
    assert written.plant["sigma2"].value == 20.0


@pytest.mark.parametrize(
    ("trial", "seed", "believed"),
    [("viscous/1", 0, False), ("2.3.1/11", 36, True), ("viscous/30", 10, True)],
)
def test_nothing_is_certain_on_a_slow_record_of_the_rig(tmp_path, trial, seed, believed):
    """It has next to no structure; values that cancel each other once had a name there."""
    rig = tmp_path / "rig"
    assert run("rig", trial, "--seed", seed, "--out", rig)[0] == 0
    given = ("--params", rig / "parameters.toml") if believed else ()
    out = ("--out", tmp_path / "out", "--json")
    code, printed, said = run("diagnose", rig / "record.csv", *given, *out)
    if code == 2:  # a motion too short to hold parts of it out
        assert "almost no motion" in said
        return
    told = json.loads(printed)
    assert code == (0 if told["verdict"] in ("none", "explained") else 1)
    if believed:
        assert not [c for c in told["causes"] if c["certain"]]
