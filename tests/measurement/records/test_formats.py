"""Files of machines by their first bytes: each format gives the same record, or one clear line.

MAT-files of any version, and what Simulink, dSPACE, Dymola and OpenModelica make of them, too.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import pickle
import zipfile
from datetime import datetime, timedelta

import h5py
import numpy as np
import pytest
import scipy.io

from ballscrew.measurement.records.reading import read_drive_records
from ballscrew.measurement.records.table import read_tables
from ballscrew.solver.errors import BadRecord

TIME = np.arange(0.0, 2.0, 1e-3)
X, U = 0.1 * np.sin(3 * TIME), 3 * np.sin(5 * TIME)
GIVEN = {"time": TIME, "x": X, "u": U}


def read(path, mapping=None, units=None, **options):
    (record,) = read_drive_records([path], mapping, units, **options)
    return record


def is_given(record, tolerance=1e-12, late=1e-9):
    np.testing.assert_allclose(record.time, TIME, atol=late)
    np.testing.assert_allclose(record.x, X, atol=tolerance)
    np.testing.assert_allclose(record.u, U, atol=1e3 * tolerance)
    return record


def text(x=X, names="time,x,u"):
    rows = (f"{t:.3f},{a:.15g},{b:.15g}" for t, a, b in zip(TIME, x, U, strict=True))
    return "\n".join([names, *rows, ""]).encode()


def write_mdf(path, **versions):
    from asammdf import MDF, Signal

    signals = [Signal(1e3 * X, TIME, name="x", unit="mm"), Signal(U, TIME, name="u", unit="V")]
    slow = Signal(20 + TIME[::100], TIME[::100], name="temperature", unit="degC")
    with MDF(**versions) as file:
        file.append(signals, acq_name="drive")
        file.append([slow], acq_name="slow")
        return file.save(path, overwrite=True)


def write_xlsx(path, dates=False):
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["This sheet has words alone"])
    sheet = book.create_sheet("Run 1")
    sheet.append(["Machine", 7])
    sheet.append(["time", "x", "u"])
    sheet.append(["s", "mm", "V"])
    for t, x, u in zip(TIME, X, U, strict=True):
        stamp = datetime(2024, 3, 1, 12) + timedelta(seconds=float(t)) if dates else float(t)
        sheet.append([stamp, 1e3 * float(x), float(u)])
    book.save(path)
    return path


@pytest.mark.parametrize("waveform", [False, True])
def test_tdms_files_with_a_column_of_time_or_with_rates(tmp_path, waveform):
    from nptdms import ChannelObject, TdmsWriter

    step = {"wf_increment": 1e-3, "wf_start_offset": 0.0} if waveform else {}
    columns = {"time": (TIME, "s"), "x": (1e3 * X, "mm"), "u": (U, "V")}
    with TdmsWriter(str(tmp_path / "a.bin")) as writer:
        channels = [
            ChannelObject("drive", name, values, {"unit_string": unit, **step})
            for name, (values, unit) in columns.items()
            if not (waveform and name == "time")
        ]
        writer.write_segment(channels)
    is_given(read(tmp_path / "a.bin"))


@pytest.mark.ci  # asammdf is large
@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_mdf_files_and_a_slower_group_where_it_is_asked_for(tmp_path, version):
    path = write_mdf(tmp_path / "a", version=version)
    is_given(read(path))
    record = is_given(read(path, {"temperature": "temperature"}))
    known = np.isfinite(record.signals["temperature"])
    np.testing.assert_allclose(record.signals["temperature"][known], 20 + TIME[::100])
    np.testing.assert_allclose(record.time[known], TIME[::100], atol=1e-9)


def test_workbooks_and_the_one_sheet_with_a_table(tmp_path):
    is_given(read(write_xlsx(tmp_path / "a.xlsx")))
    record = is_given(read(write_xlsx(tmp_path / "b", True)), late=1.1e-6)  # a day has 16 digits
    assert record.notes == ("time is in seconds from 2024-03-01 12:00:00",)


def test_hdf5_groups(tmp_path):
    with h5py.File(tmp_path / "a.dat", "w") as file:
        file["about/serial"] = 7.0
        group = file.create_group("runs/one")
        group["time"], group["x"], group["u"] = TIME, 1e3 * X, U
        group["x"].attrs["unit"] = "mm"
    is_given(read(tmp_path / "a.dat"))


def test_parquet_and_arrow_files_with_dates(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    since = (np.datetime64("2024-03-01T12:00") + (1e6 * TIME).round().astype("m8[us]")).tolist()
    table = pa.table({"time": since, "x": X, "u": U, "state": ["run"] * len(X)})
    pq.write_table(table, tmp_path / "a.data")
    with pa.ipc.new_file(tmp_path / "b.feather", table.schema) as stream:
        stream.write_table(table)
    columns = [table["time"], table["x"], table["u"], table["u"]]
    pq.write_table(pa.Table.from_arrays(columns, ["time", "x", "u", "u"]), tmp_path / "c")
    is_given(read(tmp_path / "c", {"u #2": "u"}, {"u": "V"}))
    for name in ("a.data", "b.feather"):
        assert "time is in seconds from 2024-03-01" in is_given(read(tmp_path / name)).notes[0]


def test_numpys_files_without_running_code(tmp_path):
    np.savez(tmp_path / "a.npz", **GIVEN, about=np.array({"run": 7}, dtype=object))
    is_given(read(tmp_path / "a.npz"))
    np.save(tmp_path / "b.npy", np.column_stack(list(GIVEN.values())))
    units = {"time": "s", "x": "m", "u": "V"}
    is_given(read(tmp_path / "b.npy", {"1": "time", "2": "x", "3": "u"}, units))
    np.save(tmp_path / "c.npy", np.array([{"run": 7}], dtype=object), allow_pickle=True)
    with pytest.raises(BadRecord, match="is a NumPy array that cannot be read"):
        read(tmp_path / "c.npy")
    (tmp_path / "d.pkl").write_bytes(pickle.dumps(GIVEN))
    with pytest.raises(BadRecord, match="is not a text table"):
        read(tmp_path / "d.pkl")


@pytest.mark.parametrize("pack", [gzip, lzma, bz2])
def test_packed_files_are_unpacked(tmp_path, pack):
    (tmp_path / "a.csv.packed").write_bytes(pack.compress(text()))
    is_given(read(tmp_path / "a.csv.packed"))
    again = pack.compress(pack.compress(pack.compress(pack.compress(text()))))
    (tmp_path / "c").write_bytes(pack.compress(again))
    with pytest.raises(BadRecord, match="unpack it"):
        read(tmp_path / "c")
    (tmp_path / "b").write_bytes(pack.compress(text())[:-30])
    with pytest.raises(BadRecord, match=r"is an? .* file that cannot be read"):
        read(tmp_path / "b")


def test_a_zip_of_one_file_is_unpacked_and_one_of_several_is_refused(tmp_path):
    for name, members in {"a.zip": ["a.csv"], "b.zip": ["a.csv", "b.csv"]}.items():
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for member in members:
                archive.writestr(member, text())
    is_given(read(tmp_path / "a.zip"))
    with pytest.raises(BadRecord, match="a ZIP archive of 2 files; unpack it and give one"):
        read(tmp_path / "b.zip")


@pytest.mark.ci
def test_a_text_that_begins_as_a_format_does_is_a_text(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"LOGGER;7;8\nRIFF\n" + text())
    is_given(read(tmp_path / "a.csv"))


def mat73(path, fill):
    """A file as MATLAB lays it out: HDF5 behind a header of 512 bytes, arrays transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\2IM"
    with path.open("r+b") as stream:
        stream.write(head)
    return path


@pytest.mark.parametrize("form", ["4", "5"])
def test_vectors_of_a_mat_file_are_columns_by_their_names(tmp_path, form):
    scipy.io.savemat(tmp_path / "record", GIVEN, format=form, appendmat=False)
    is_given(read(tmp_path / "record"))


def test_a_structure_with_time_has_its_labels(tmp_path):
    one = {"values": np.column_stack([X, U]), "dimensions": 2.0, "label": "both"}
    scipy.io.savemat(tmp_path / "a.mat", {"out": {"time": TIME, "signals": one}})
    is_given(read(tmp_path / "a.mat", {"both.1": "x", "both.2": "u"}, {"x": "m", "u": "V"}))


def test_dspace_units_and_axes_are_taken(tmp_path):
    signals = [
        {"Name": "Pos", "Data": 1e3 * X, "Unit": "mm", "XIndex": 1.0},
        {"Name": "U", "Data": U, "Unit": "V", "XIndex": 1.0},
        {"Name": "Temp", "Data": U[::100], "Unit": "degC", "XIndex": 2.0},
    ]
    axes = [{"Data": TIME}, {"Data": TIME[::100]}]
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"rec": {"X": axes, "Y": signals, "Description": "d"}})
    record = is_given(read(path, {"Pos": "x", "U": "u", "Temp": "temperature"}))
    assert np.isfinite(record.signals["temperature"]).sum() == 20


def rows_of(texts):
    width = max(map(len, texts))
    return np.array([list(t.ljust(width)) for t in texts])


@pytest.mark.parametrize("turned", [True, False])
def test_results_of_modelica_have_signs_aliases_and_units(tmp_path, turned):
    names = ["time", "axis.s", "axis.back", "motor.v", "axis.m", "axis.v"]
    texts = ["Time [s]", "Position [mm|m]", "Its mirror", "Voltage [V]", "Mass [kg]", "Speed [m/s]"]
    info = np.array([[0, 1], [2, 2], [2, -2], [2, 3], [1, 2], [2, 3]], dtype="i4")
    info = np.column_stack([info, np.zeros(6, "i4"), -np.ones(6, "i4")])
    data = np.column_stack([TIME, 1e3 * X, U])
    constant = np.array([[0.0, 5.0], [2.0, 5.0]])
    kind = "binTrans" if turned else "binNormal"
    given = {"Aclass": rows_of(["Atrajectory", "1.1", "", kind])}
    matrices = {"name": rows_of(names), "description": rows_of(texts), "dataInfo": info}
    matrices |= {"data_1": constant, "data_2": data}
    given |= {n: v.T if turned else v for n, v in matrices.items()}
    for name, values in given.items():
        if values.dtype.kind == "U":
            given[name] = np.array(["".join(row) for row in values])
    path = tmp_path / "dsres.mat"
    scipy.io.savemat(path, given, format="4")
    record = is_given(read(path, {"axis.s": "x", "motor.v": "u"}))
    (table,) = read_tables(path)
    assert table.units == {"time": "s", "axis.s": "mm", "motor.v": "V", "axis.v": "m/s"}
    np.testing.assert_allclose(table.columns["axis.back"], -1e3 * record.x, atol=1e-9)


def test_version_7_3_has_vectors_matrices_and_structures(tmp_path):
    def vectors(file):
        for name, values in (("time", TIME), ("x", X), ("u", U)):
            file.create_dataset(name, data=values[None]).attrs["MATLAB_class"] = np.bytes_("double")

    def matrix(file):
        file.create_dataset("ans", data=np.column_stack([TIME, X, U]))

    def scope(file):
        top = file.create_group("Scope")
        top.create_dataset("time", data=TIME[None])
        signals, refs = top.create_group("signals"), file.create_group("#refs#")
        for field, *pair in (("values", X, U), ("label", [[ord("x")]], [[ord("u")]])):
            data = map(np.atleast_2d, pair)
            made = [refs.create_dataset(f"{field}{k}", data=d) for k, d in enumerate(data)]
            for item in made if field == "label" else ():
                item.attrs["MATLAB_class"] = np.bytes_("char")
            refs_of = np.array([item.ref for item in made], dtype=h5py.ref_dtype)
            signals.create_dataset(field, data=refs_of[:, None])

    is_given(read(mat73(tmp_path / "a.mat", vectors)))
    names, units = {"ans.1": "time", "ans.2": "x", "ans.3": "u"}, {"time": "s", "x": "m", "u": "V"}
    is_given(read(mat73(tmp_path / "b.mat", matrix), names, units))
    is_given(read(mat73(tmp_path / "c.mat", scope)))
