"""Records as other programs write them: layouts, formats and units."""

import json
import time

import case_inputs
import numpy as np
import pytest
from cases import case

from ballscrew import read_drive_records, read_force_records
from ballscrew.measurement.records.sampling import recounted
from ballscrew.solver.errors import BadRecord

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
        ("time_as_date", "run.csv", None, None, 2000),
        ("words_beside_the_table", "scope.csv", {"4": "time", "5": "x", "6": "u"}, SI, 1500),
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


@pytest.mark.parametrize("unit", ["turns", "%"])
def test_inches_in_brackets_become_metres_and_any_other_word_is_refused(tmp_path, unit):
    file = case("record_unit_in_brackets_unknown", tmp_path) / "run.csv"
    inches = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1]
    (record,) = read_drive_records([file], {"x [in]": "x"})
    np.testing.assert_allclose(record.x, 0.0254 * inches, rtol=1e-9, atol=1e-12)
    file.write_text(file.read_text().replace("[in]", f"[{unit}]"))
    with pytest.raises(BadRecord, match=f"x is in '{unit}'; use unit x= with one of m, "):
        read_drive_records([file], {f"x [{unit}]": "x"})
    (record,) = read_drive_records([file], None, {"x": "in"})
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
        assert said == f"{line}\n"


@pytest.mark.parametrize(
    ("file", "units", "off"),
    [
        ("run.parquet", {"time": "1e-9*s"}, 5e-7),
        ("run.npz", None, 1e-6),  # float32 has steps of 0.5 ms there
    ],
)
def test_stamps_of_a_fast_record_are_as_exact_as_what_was_written(tmp_path, file, units, off):
    (record,) = read_drive_records([case("fast_stamps", tmp_path) / file], None, units)
    t, x, u = case_inputs.swing(2600, 4e-4)
    assert record.step == pytest.approx(4e-4, rel=1e-6)
    np.testing.assert_allclose(record.time - record.time[0], t, rtol=0, atol=off)
    np.testing.assert_allclose([record.x, record.u], [x, u], rtol=0, atol=1e-12)
    rounded = "time was rounded to float32, to steps of 0.000488: even stamps were fitted"
    assert (rounded in record.notes) == (file == "run.npz")


def test_packed_numbers_and_empty_cells_of_netcdf_are_what_they_stand_for(tmp_path):
    (record,) = read_drive_records([case("hdf5_scale_factor", tmp_path) / "run.h5"])
    t, x, _ = case_inputs.swing()
    np.testing.assert_allclose(record.time, t, atol=1e-9)
    np.testing.assert_allclose(np.delete(record.x, 700), np.delete(x, 700), atol=0.51e-6)
    assert record.x[700] == pytest.approx(record.x[[699, 701]].mean(), abs=1e-12)
    assert record.notes[0].startswith("1 samples missing")


def test_a_meters_overflow_is_no_value(tmp_path):
    t, x, u = case_inputs.swing()
    over = np.isin(np.arange(len(t)), [300, 900, 901])
    case_inputs.write(tmp_path / "a.csv", "time,x,u", "g g g", t, np.where(over, 9.9e37, x), u)
    (record,) = read_drive_records([tmp_path / "a.csv"])
    np.testing.assert_allclose(record.x, x, atol=1e-5)
    assert record.notes[0].startswith("3 samples missing")


def test_samples_that_a_counted_time_has_lost_get_their_place(tmp_path):
    folder = case("samples_lost_under_even_stamps", tmp_path)
    (record,) = read_force_records([folder / "run.csv"])
    true = np.load(folder / "true.npy")
    x = case_inputs.swings(record.time, (0.03, 0.7), (0.008, 2.1))[0]
    np.testing.assert_allclose(record.x, x, rtol=0, atol=4e-4)  # 240 samples move by 0.02 m
    assert len(record.time) == pytest.approx(1e3 * true[-1] + 1, abs=3)
    assert any("samples are missing there" in note for note in record.notes)


def test_a_position_that_is_made_at_another_rate_than_it_is_read_keeps_its_stamps(tmp_path):
    (tmp_path / "even").mkdir()
    case_inputs.samples_lost_under_even_stamps(tmp_path / "even", every=40)
    (record,) = read_force_records([tmp_path / "even" / "run.csv"])
    np.testing.assert_allclose(record.time, 1e-3 * np.arange(len(record.time)), atol=1e-9)
    assert not any("missing" in note for note in record.notes)
    random = np.random.default_rng(21)  # instants that jitter by most of a step
    t = 1e-3 * np.arange(60_000)
    x = case_inputs.swings(t + random.uniform(0, 0.8e-3, t.size), (0.03, 0.7), (0.008, 2.1))[0]
    np.testing.assert_array_equal(recounted(t, x)[0], t)


@pytest.mark.ci
def test_the_mass_is_found_where_samples_were_lost_and_every_note_is_printed(tmp_path, command):
    folder = case("samples_lost_under_even_stamps", tmp_path)
    law = "--law classical --mass fit --fix Vs=0.01"
    units = "--unit force=N --unit x=m --unit time=s"
    _, _, said = command(folder, f"identify run.csv {law} {units} --out out")
    told = json.loads((folder / "out" / "identified.json").read_text())
    mass = told["parameters"]["m"]
    assert mass["low"] < 5.0 < mass["high"]
    notes = [note for note in told["record_notes"]["run.csv"] if "samples" in note]
    assert len(notes) > 1
    assert all(f"note: run.csv: {note}\n" in said for note in notes)


@pytest.mark.parametrize(
    ("name", "file", "words"),
    [
        ("xlsx_far_cell", "far.xlsx", "row 1048576: 16384 cells, expected 3"),
        ("header_brackets", "record.csv", "50004 characters in the name of a column, expected"),
    ],
)
def test_a_small_file_with_a_huge_table_is_refused_at_once(tmp_path, name, file, words):
    begun = time.perf_counter()
    with pytest.raises(BadRecord, match=words):
        read_drive_records([case(name, tmp_path) / file])
    assert time.perf_counter() - begun < 5.0
