"""Records: read anybody's file, complain of every fault in one line, never guess a unit."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scipy.io

from ballscrew.records.bad_record import BadRecord
from ballscrew.records.force_record import read_record, read_records


def columns(n=100):
    time = 0.005 * np.arange(n)
    x = 1e-3 * (1 - np.cos(time))
    return {"time": time, "x": x, "force": 1.5 + 0.2 * np.sin(3 * time)}


def write(path, table):
    names = list(table)
    rows = zip(*table.values(), strict=True)
    lines = [",".join(names), *(",".join(str(v) for v in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def complaint(path, **options):
    with pytest.raises(BadRecord) as caught:
        read_record(path, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_csv_and_mat_with_other_names_and_units_give_the_same_record(tmp_path):
    table = columns()
    theirs = {"t": table["time"] * 1e3, "q": table["x"] * 1e3, "F": table["force"]}
    csv_file = write(tmp_path / "a.csv", theirs)
    mat_file = tmp_path / "a.mat"
    scipy.io.savemat(mat_file, {n: v[:, None] for n, v in theirs.items()} | {"gain": 3.0})
    options = {
        "mapping": {"t": "time", "q": "x", "F": "force"},
        "units": {"time": "ms", "x": "mm"},
        "mass": 2.5,
    }
    for record in (read_record(csv_file, **options), read_record(mat_file, **options)):
        for name, values in table.items():
            np.testing.assert_allclose(record.signals[name], values, rtol=1e-12, atol=1e-15)
        assert record.step == pytest.approx(0.005)
        assert record.mass == 2.5


def test_a_rig_folder_gives_mass_and_lags_and_a_folder_of_them_gives_all(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "record.csv", columns())
        about = {"parameters": {"plant.m": 1.5}, "lags": {"x": 0.0, "force": 0.002}}
        (tmp_path / name / "trial.json").write_text(json.dumps(about))
    records = read_records([tmp_path])
    assert len(records) == 2
    assert records[0].mass == 1.5
    assert records[0].lags["force"] == 0.002


def test_a_missing_column_is_named_with_the_nearest_ones(tmp_path):
    table = columns()
    table["Forces"] = table.pop("force")
    message = complaint(write(tmp_path / "a.csv", table))
    assert "'force'" in message
    assert "Forces" in message
    assert "--map" in message


def test_a_mapped_column_that_is_not_there_is_named(tmp_path):
    path = write(tmp_path / "a.csv", columns())
    assert "no column 'F'" in complaint(path, mapping={"F": "force"})


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("short", "too short: 5 samples"),
        ("constant position", "x is constant"),
        ("constant force", "force is constant"),
        ("gap", "a gap of 0.05 s after 0.25 s"),
        ("backwards", "time goes backwards in row 52"),
        ("standing", "time stands still in row 52"),
        ("uneven", "uneven sampling"),
        ("nan", "force is empty or not a number in 1 of 100 samples, the first in row 42"),
        ("slow column", "lower rate"),
        ("text", "'abc' is no number"),
        ("twice", "is there twice"),
        ("empty", "is empty"),
        ("ragged", "row 3: 2 cells, expected 3"),
    ],
)
def test_each_fault_of_a_file_is_said_in_one_line(tmp_path, fault, words):
    table = columns()
    path = tmp_path / "a.csv"
    if fault == "short":
        table = columns(5)
    elif fault.startswith("constant"):
        table["x" if "position" in fault else "force"][:] = 0.089
    elif fault == "gap":
        keep = np.r_[0:51, 60:100]
        table = {n: v[keep] for n, v in table.items()}
    elif fault == "backwards":
        table["time"][50] = 0.1
    elif fault == "standing":
        table["time"][50] = table["time"][49]
    elif fault == "uneven":
        table["time"][50] -= 0.002
    elif fault == "nan":
        table["force"][40] = math.nan
    elif fault == "slow column":
        table["force"][1::2] = math.nan
    write(path, table)
    text = path.read_text()
    if fault == "text":
        path.write_text(text.replace("0.005,", "abc,", 1))
    elif fault == "twice":
        path.write_text(text.replace("time,x,force", "time,x,x"))
    elif fault == "empty":
        path.write_text("")
    elif fault == "ragged":
        lines = text.splitlines()
        lines[2] = lines[2].rsplit(",", 1)[0]
        path.write_text("\n".join(lines))
    assert words in complaint(path)


def test_columns_of_different_rates_are_refused(tmp_path):
    table = columns()
    table["force"] = table["force"][::2]
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, table)
    assert "different rates" in complaint(path)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("x", 1e6, "mm"), ("time", 1e3, "ms"), ("force", 1e4, "mN"), ("force", 1e-3, "kN")],
)
def test_numbers_that_look_like_another_unit_are_refused_until_the_unit_is_said(
    tmp_path, name, factor, unit
):
    table = columns()
    table[name] = table[name] * factor
    path = write(tmp_path / "a.csv", table)
    message = complaint(path)
    assert f"--unit {name}={unit}" in message
    si = {"x": "m", "time": "s", "force": "N"}[name]
    record = read_record(path, units={name: si})
    np.testing.assert_allclose(record.signals[name], table[name])


def test_what_is_no_file_and_what_is_no_mat_file_is_said(tmp_path):
    assert "no such file" in complaint(tmp_path / "none.csv")
    (tmp_path / "bad.mat").write_bytes(b"nonsense")
    assert "no MAT file" in complaint(tmp_path / "bad.mat")
    with pytest.raises(BadRecord, match=r"no record\.csv"):
        read_records([tmp_path])
