"""Records of either use: anybody's file to SI at even instants, every fault in one line."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scipy.io

from ballscrew.measurement.records.examine import check_identifiable
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


@pytest.mark.parametrize(
    ("unit", "size"),
    [("mm/min", 1e-3 / 60), ("m/min", 1 / 60), ("km/h", 1 / 3.6), ("in/s", 0.0254), ("um/s", 1e-6)],
)
def test_a_speed_has_the_unit_in_its_header(tmp_path, unit, size):
    speed = 0.3 * np.cos(3 * TIME)
    table = {"time": TIME, "u": MOTION["u"], f"v [{unit}]": speed / size}
    record = read(write(tmp_path / "a.csv", table))
    np.testing.assert_allclose(record.signals["v"], speed, rtol=1e-9, atol=1e-11)


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
    ("change", "words"),
    [
        (lambda text: "\n".join(text.split("\n")[:6]), "too short: 5 samples"),
        (lambda text: text.replace("0.005,", "abc,", 1), "'abc' is not a number"),
        (lambda _: "", "is empty"),
        (lambda text: text.replace("\n0.005,", "\n0.005;", 1), "row 3: 2 cells, expected 3"),
        (lambda text: text.replace("\n0.25,", "\n0.1,"), "time decreases in row 52"),
    ],
)
def test_each_fault_of_a_text_is_said_in_one_line(tmp_path, change, words):
    path = write(tmp_path / "a.csv", columns())
    path.write_text(change(path.read_text()))
    assert words in complaint(path)


@pytest.mark.ci
def test_each_fault_of_a_column_is_said_in_one_line(tmp_path):
    for name in ("x", "force"):
        path = write(tmp_path / "a.csv", columns() | {name: np.full(100, 0.089)})
        assert f"{name} is constant" in complaint(path)
    slow = np.where(np.arange(100) % 2, math.nan, columns()["force"])
    assert "lower rate" in complaint(write(tmp_path / "a.csv", columns() | {"force": slow}))
    scipy.io.savemat(tmp_path / "a.mat", columns() | {"force": slow[::2]})
    rates = "columns of different length (time 100, x 100, force 50 samples)"
    assert rates in complaint(tmp_path / "a.mat")


@pytest.mark.ci
@pytest.mark.parametrize(
    ("name", "factor", "unit"), [("x", 1e6, "mm"), ("time", 1e3, "ms"), ("force", 1e-3, "kN")]
)
def test_numbers_that_look_like_another_unit_are_refused_until_the_unit_is_said(
    tmp_path, name, factor, unit
):
    table = columns()
    table[name] = table[name] * factor
    path = write(tmp_path / "a.csv", table)
    assert f"unit {name}={unit}" in complaint(path)
    si = {"x": "m", "time": "s", "force": "N"}[name]
    (record,) = read_force_records([path], units={name: si})
    np.testing.assert_allclose(record.signals[name], table[name])


LEAD = 0.002
WAY, SPEED = 0.02 * (1 - np.cos(3 * TIME)), 0.06 * np.sin(3 * TIME)
TRAPEZOID = 1e-6 / 12 * 4 * 0.18  # by a step of 1 ms of the trapezium rule, at most, and digits
# what a motor controller writes: lines of its own, a column without a name, a line of units
EXPORT = """Date:;2020-07-08 22:13:00
Firmware Version:;0x0120;0x6150;0x0000;0x0000
Trigger:;1;0.000000;"Parameter values";"Channel 1"
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%
"""
NAMES = {"1": "time", "Velocity actual value averaged": "v", "Torque actual value averaged": "u"}


@pytest.mark.parametrize("unit", ["9.84e-5*N*m", "0.0984 mNm"])
def test_a_drive_controllers_export_is_read_as_it_was_written(tmp_path, unit):
    """Of a nominal torque of 9.84 mN*m, in per cent."""
    rpm, per_cent = SPEED / LEAD * 60, 100 * MOTION["u"] * LEAD / (2 * math.pi) / 9.84e-3
    rows = zip(1e3 * TIME, rpm, per_cent, strict=True)
    path = tmp_path / "a.csv"
    path.write_text(EXPORT + "\n".join(f"{t:.3f};{v:.6f};{p:.6f}" for t, v, p in rows))
    (record,) = read_drive_records([path], NAMES, {"u": unit}, LEAD)
    np.testing.assert_allclose(record.x, WAY, atol=TRAPEZOID)
    np.testing.assert_allclose(record.u, MOTION["u"], atol=1e-5)
    assert record.command == "force"
    assert record.velocity_alone
    assert any("x is the integral of v" in note for note in check_identifiable([record]))


def test_a_velocity_beside_a_position_is_left_aside():
    record = check_record("mine", MOTION | {"x": WAY, "v": 7 * SPEED})
    np.testing.assert_array_equal(record.x, WAY)
    assert not record.velocity_alone


def test_a_velocity_in_another_unit_than_was_said_is_refused(tmp_path):
    signals = {"time": TIME, "u": MOTION["u"], "v": SPEED / LEAD * 60}
    with pytest.raises(BadRecord, match=r"v covers .* m, too much for m/s; .* unit v=rpm"):
        check_record("mine", signals)
    path = write(tmp_path / "a.csv", {"time": TIME, "v": 1e4 * SPEED, "force": MOTION["u"]})
    assert "unit v=mm/s" in complaint(path)


@pytest.fixture
def rig_folder(tmp_path):
    table = columns(300) | {"u": np.sin(0.005 * np.arange(300))}
    about = {"parameters": {"plant.m": 1.5}, "lags": {"x": 0.0, "force": 0.002}}
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "record.csv", table)
        (tmp_path / name / "trial.json").write_text(json.dumps(about))
    return tmp_path


def test_a_rig_folder_gives_mass_and_lags_and_a_folder_of_them_gives_all(rig_folder):
    records = read_force_records([rig_folder])
    assert [(r.mass, r.lags["force"], r.notes) for r in records] == [(1.5, 0.002, ())] * 2
    assert read_force_records([rig_folder], mass=2.5)[0].mass == 2.5
    assert [r.name for r in read_drive_records([rig_folder])] == [r.name for r in records]
    (alone,) = read_force_records([rig_folder / "one" / "record.csv"])
    assert (alone.mass, alone.lags) == (1.0, {})
    assert any("no trial.json" in note for note in alone.notes)


@pytest.mark.ci
@pytest.mark.parametrize(
    "text", ["[", "[]", '{"lags": 3}', '{"parameters": {"plant.m": -1}}', '{"lags": {"x": "a"}}']
)
def test_what_no_rig_writes_is_refused(rig_folder, text):
    (rig_folder / "two" / "trial.json").write_text(text)
    with pytest.raises(BadRecord, match=r"trial.json: (is not JSON of an object|expected `param)"):
        read_force_records([rig_folder])
    assert len(read_drive_records([rig_folder])) == 2
