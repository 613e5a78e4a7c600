"""Records as other programs write them: layouts, formats and units."""

import numpy as np
import pytest
from cases import case

from ballscrew import read_drive_records
from ballscrew.records.bad_record import BadRecord

SI = {"time": "s", "x": "m", "u": "V"}
BY_NUMBER = {"1": "time", "2": "x", "4": "u"}
BY_NAME = {"Axis.ActPos": "x", "Axis.Torque": "u"}
TO_FILE = {"ans.1": "time", "ans.2": "x", "ans.3": "u"}


@pytest.mark.parametrize(
    ("name", "file", "mapping", "units", "samples"),
    [
        ("labview_lvm", "run.lvm", {"X_Value": "time", "Position": "x", "Voltage": "u"}, SI, 1500),
        ("twincat_scope_eof", "scope.csv", BY_NUMBER, {"time": "ms", "x": "mm"}, 1500),
        ("twincat_scope_eof", "scope.csv", BY_NAME, {"time": "ms"}, 1500),
        ("mat_matrix", "tofile.mat", TO_FILE, SI, 2000),
        ("mat_matrix", "scope.mat", {"pos": "x", "volt": "u"}, SI, 2000),
        ("mat_matrix", "dspace.mat", {"Pos": "x", "U": "u"}, SI, 2000),
        ("time_as_date", "run.csv", None, None, 2000),
    ],
)
def test_the_same_motion_is_read_from_every_layout(tmp_path, name, file, mapping, units, samples):
    """0.03 m at 1.9 Hz, sampled at 1 kHz, in files with 1e-6 m."""
    (record,) = read_drive_records([case(name, tmp_path) / file], mapping, units)
    t = 1e-3 * np.arange(samples)
    angle, rate = 2 * np.pi * 1.9 * t, 2 * np.pi * 1.9 * 0.03
    np.testing.assert_allclose(record.time, t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(record.x, 0.03 * np.sin(angle), rtol=0, atol=0.51e-6)
    voltage = 11 * rate * np.cos(angle) + 3 * np.cos(2 * np.pi * 3 * t)
    np.testing.assert_allclose(record.u, voltage, rtol=0, atol=0.51e-6)


def test_what_was_done_to_a_record_is_told(tmp_path):
    (record,) = read_drive_records([case("time_as_date", tmp_path) / "run.csv"])
    assert record.notes == ("time is in seconds from 2024-03-01T12:00:00.000000",)
    file = case("twincat_scope_eof", tmp_path) / "scope.csv"
    (record,) = read_drive_records([file], BY_NAME, {"time": "ms"})
    assert record.notes[0].startswith("1 invalid line of the table left out")


def test_a_matrix_without_names_is_named_by_its_rows(tmp_path):
    with pytest.raises(BadRecord, match=r"has no column 'time'.*; there are ans.1, ans.2, ans.3"):
        read_drive_records([case("mat_matrix", tmp_path) / "tofile.mat"])


def test_an_angle_that_wraps_goes_on_and_it_is_said(tmp_path):
    file = case("angle_wraps", tmp_path) / "run.csv"
    (record,) = read_drive_records([file], lead=0.001)
    assert any("wraps around and was unwrapped" in note for note in record.notes)
    assert np.abs(np.diff(record.x)).max() < 0.1e-3  # no step of a tenth of a turn is left
    angle = np.loadtxt(file, delimiter=",", skiprows=1, usecols=1)
    turns = (record.x * 360e3 - angle) / 360
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)


def test_a_dot_in_a_file_of_decimal_commas_stands_between_thousands(tmp_path):
    file = case("record_thousands_dot", tmp_path) / "run.csv"
    (record,) = read_drive_records([file], None, {"x": "um"})
    whole = [int(row.split(";")[1].replace(".", "")) for row in file.read_text().split()[1:]]
    assert max(whole) > 10_000
    np.testing.assert_allclose(record.x, 1e-6 * np.array(whole), atol=1e-15)


def test_inches_in_brackets_behind_a_name_become_metres(tmp_path):
    file = case("record_unit_in_brackets_unknown", tmp_path) / "run.csv"
    inches = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1]
    for mapping in (None, {"x [in]": "x"}):
        (record,) = read_drive_records([file], mapping)
        np.testing.assert_allclose(record.x, 0.0254 * inches, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("unit", ["turns", pytest.param("%", marks=pytest.mark.ci)])
def test_any_other_word_in_brackets_is_refused_with_what_to_say(tmp_path, unit):
    file = case("record_unit_in_brackets_unknown", tmp_path) / "run.csv"
    file.write_text(file.read_text().replace("[in]", f"[{unit}]"))
    with pytest.raises(BadRecord, match=f"x is in '{unit}'; use --unit x= with one of m, "):
        read_drive_records([file], {f"x [{unit}]": "x"})
    (record,) = read_drive_records([file], None, {"x": "in"})
    inches = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1]
    np.testing.assert_allclose(record.x, 0.0254 * inches, rtol=1e-9, atol=1e-12)


def test_a_damaged_file_is_called_by_its_format_with_what_to_save(tmp_path, command):
    folder = case("binary_measurement_files", tmp_path)
    (folder / "axis.toml").write_text('kind = "ball_screw"\nlaw = "lugre"\n')
    names = {"h5": "an HDF5", "mf4": "an MDF", "tdms": "a TDMS", "xlsx": "an Excel workbook"}
    for suffix, name in names.items():
        code, _, said = command(folder, f"diagnose a.{suffix} --params axis.toml --out out")
        line = said.splitlines()[-1]
        assert code == 2
        assert f"a.{suffix}: is {name}" in line
        assert line.endswith("CSV")
