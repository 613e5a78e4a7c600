"""Records of either use: anybody's file to SI at even instants, every fault in one line."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.io

from ballscrew.measurement.records.reading import (
    check_record,
    read_drive_records,
    read_force_records,
)
from ballscrew.solver.errors import BadRecord

TIME = np.arange(0.0, 2.0, 1e-3)
MOTION = {"time": TIME, "u": 3 * np.sin(5 * TIME), "x": 0.1 * np.sin(3 * TIME)}


def write(path, table, header=None):
    names = header or ",".join(table)
    data = np.column_stack(list(table.values()))
    np.savetxt(path, data, delimiter=",", header=names, comments="", fmt="%.12g")
    return path


def read(path, **options):
    (record,) = read_drive_records([path], **options)
    return record


@pytest.mark.parametrize(
    ("column", "unit", "size"),
    [
        ("time", "ms", 1e-3),
        ("x", "mm", 1e-3),
        ("x", "2.5e-6*m", 2.5e-6),
        ("x", "in", 0.0254),
        ("u", "-1*V", -1.0),
        ("u", "kV", 1e3),
        ("force", "kN", 1e3),
    ],
)
def test_units_are_said_for_each_column(tmp_path, column, unit, size):
    given = MOTION | {"i": 0.5 * np.cos(TIME), "force": 2 * np.cos(3 * TIME)}
    path = write(tmp_path / "a.csv", given | {column: given[column] / size})
    record = read(path, units={column: unit})
    np.testing.assert_allclose(record.signals[column], given[column], rtol=1e-9, atol=1e-11)
    assert record.command == "voltage"


@pytest.mark.parametrize(("unit", "per_turn"), [("rad", 2 * math.pi), ("deg", 360.0)])
def test_a_rotary_record_becomes_a_linear_one_of_the_same_work(tmp_path, unit, per_turn):
    lead, torque = 0.005, 0.3 * np.sin(TIME)
    path = write(tmp_path / "a.csv", MOTION | {"u": torque, "x": MOTION["x"] / lead * per_turn})
    record = read(path, units={"x": unit, "u": "N*m"}, lead=lead)
    np.testing.assert_allclose(record.x, MOTION["x"], atol=1e-12)
    assert record.command == "force"
    angle = 2 * math.pi * MOTION["x"] / lead
    np.testing.assert_allclose(
        np.sum(record.u[1:] * np.diff(record.x)), np.sum(torque[1:] * np.diff(angle)), rtol=1e-9
    )


def test_the_current_alone_is_a_command_and_a_force_is_one(tmp_path):
    path = write(tmp_path / "a.csv", {"time": TIME, "i": MOTION["u"], "x": MOTION["x"]})
    record = read(path)
    assert record.current_alone
    assert record.command == "current"
    assert read(write(tmp_path / "b.csv", MOTION), units={"u": "N"}).command == "force"


@pytest.mark.ci
@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"x": "inch"}, "expected one of m, cm, mm, um, nm, in, ft, rad, deg, rev, or a number"),
        ({"x": "0*m"}, "unit x=0[*]m: expected one of m"),
        ({"speed": "rpm"}, "columns are time, u, x"),
        ({"x": "deg"}, "give lead in metres"),
    ],
)
def test_units_that_make_no_sense_are_refused(tmp_path, units, words):
    with pytest.raises(BadRecord, match=words):
        read(write(tmp_path / "a.csv", MOTION), units=units)


@pytest.mark.ci
@pytest.mark.parametrize("factor", [50.0, 1e3])
def test_slow_records_and_times_that_are_no_seconds_are_refused(factor):
    signals = MOTION | {"time": factor * TIME}
    if factor < 1e3:  # a motion recorded at 20 Hz, or 10 Hz
        signals = {n: v[:500] for n, v in signals.items()}
    with pytest.raises(BadRecord, match=r"too slow for friction; .* unit time=ms"):
        check_record("mine", signals)


def test_missing_repeated_and_jittering_samples_are_put_right_and_said():
    random = np.random.default_rng(0)
    time = TIME + 4e-4 * random.uniform(-1, 1, len(TIME))
    signals = {"time": time, "u": 3 * np.sin(5 * time), "x": 0.1 * np.sin(3 * time)}
    signals["x"][700] = np.nan
    keep = np.sort(np.r_[np.delete(np.arange(len(TIME)), [300, 301, 900, 1200]), 500])
    record = check_record("mine", {n: v[keep] for n, v in signals.items()})
    assert record.step == pytest.approx(1e-3, rel=1e-3)
    np.testing.assert_allclose(np.diff(record.time), record.step, rtol=1e-9)
    np.testing.assert_allclose(record.x, 0.1 * np.sin(3 * record.time), atol=2e-6)
    (note,) = record.notes
    assert "1 with a repeated time stamp" in note
    assert "stamps up to 0.3" in note or "stamps up to 0.4" in note
    assert "resampled every 1 ms" in note


def test_slower_instruments_values_stay_where_they_were_when_samples_are_missing():
    slow = np.full(len(TIME), np.nan)
    slow[::10] = TIME[::10]
    keep = np.delete(np.arange(len(TIME)), [301, 302])
    signals = MOTION | {"temperature": slow}
    record = check_record("mine", {n: v[keep] for n, v in signals.items()})
    known = np.isfinite(record.signals["temperature"])
    assert known.sum() == 200
    np.testing.assert_allclose(record.signals["temperature"][known], record.time[known], atol=1e-9)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("keep", "words"),
    [
        (np.r_[0:500, 550:2000], "a gap of 0.051 s after 0.499 s"),
        (np.r_[0:500, 499:100:-1, 500:2000], "time decreases in row 502"),
        (np.repeat(np.arange(2000), 2), "the time stamps are coarser than the sampling"),
        (np.flatnonzero(np.arange(2000) % 4 < 2), "uneven sampling"),
    ],
)
def test_times_that_cannot_be_put_right_are_refused(keep, words):
    with pytest.raises(BadRecord, match=words):
        check_record("mine", {n: v[keep] for n, v in MOTION.items()})


def test_a_record_with_gaps_is_its_pieces(tmp_path):
    time = np.arange(0.0, 6.0, 1e-3)
    keep = np.r_[0:2000, 2500:2600, 3000:6000]  # the middle one is too short
    given = {"time": time, "u": 3 * np.sin(5 * time), "x": 0.1 * np.sin(3 * time)}
    path = write(tmp_path / "a.csv", {n: v[keep] for n, v in given.items()})
    first, second = read_drive_records([path])
    assert (first.name, second.name) == (f"{path} (1 of 2)", f"{path} (2 of 2)")
    np.testing.assert_allclose(first.x, given["x"][:2000], atol=1e-9)
    np.testing.assert_allclose(second.time, time[3000:], atol=1e-9)
    (note,) = second.notes
    assert note.startswith(
        "2 gaps, the first of 0.501 s after 1.999 s: the record was divided there"
    )
    assert note.endswith("into 2 pieces of at least 1 s; 2 % of its samples are in shorter ones")


def columns(n=100):
    time = 0.005 * np.arange(n)
    x = 1e-3 * (1 - np.cos(time))
    return {"time": time, "x": x, "force": 1.5 + 0.2 * np.sin(3 * time)}


def complaint(path, **options):
    with pytest.raises(BadRecord) as caught:
        read_force_records([path], **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.ci
@pytest.mark.parametrize("unit", ["", "-"])
def test_a_column_of_another_name_without_a_unit_is_asked_for_it(tmp_path, unit):
    """One that the file calls by our name is in SI units, as `ballscrew` writes it."""
    table = columns()
    table[f"q [{unit}]" if unit else "q"] = table.pop("x")
    path = write(tmp_path / "a.csv", table)
    said = complaint(path, mapping={"q": "x"})
    assert "gives no unit of 'q', which is x by map; use unit x= with one of m, cm, mm" in said
    assert read_force_records([path], {"q": "x"}, {"x": "m"})


@pytest.mark.ci
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("short", "too short: 5 samples"),
        ("constant position", "x is constant"),
        ("constant force", "force is constant"),
        ("backwards", "time decreases in row 52"),
        ("slow column", "lower rate"),
        ("text", "'abc' is not a number"),
        ("empty", "is empty"),
        ("ragged", "row 3: 2 cells, expected 3"),
        ("rates", "columns of different length (time 100, x 100, force 50 samples)"),
    ],
)
def test_each_fault_of_a_file_is_said_in_one_line(tmp_path, fault, words):
    table = columns()
    path = tmp_path / "a.csv"
    if fault == "short":
        table = columns(5)
    elif fault.startswith("constant"):
        table["x" if "position" in fault else "force"][:] = 0.089
    elif fault == "backwards":
        table["time"][50] = 0.1
    elif fault == "slow column":
        table["force"][1::2] = math.nan
    write(path, table)
    text = path.read_text()
    if fault == "text":
        path.write_text(text.replace("0.005,", "abc,", 1))
    elif fault == "empty":
        path.write_text("")
    elif fault == "ragged":
        lines = text.splitlines()
        lines[2] = lines[2].rsplit(",", 1)[0]
        path.write_text("\n".join(lines))
    elif fault == "rates":
        path = tmp_path / "a.mat"
        scipy.io.savemat(path, table | {"force": table["force"][::2]})
    assert words in complaint(path)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("x", 1e6, "mm"), ("time", 1e3, "ms"), ("force", 1e-3, "kN")],
)
def test_numbers_that_look_like_another_unit_are_refused_until_the_unit_is_said(
    tmp_path, name, factor, unit
):
    table = columns()
    table[name] = table[name] * factor
    path = write(tmp_path / "a.csv", table)
    message = complaint(path)
    assert f"unit {name}={unit}" in message
    si = {"x": "m", "time": "s", "force": "N"}[name]
    (record,) = read_force_records([path], units={name: si})
    np.testing.assert_allclose(record.signals[name], table[name])
