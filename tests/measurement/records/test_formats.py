"""Files of machines by their first bytes: each format gives the same record, or one clear line."""

from __future__ import annotations

import bz2
import gzip
import lzma
import pickle
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pytest

from ballscrew.measurement.records.reading import read_drive_records
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


def write_tdms(path, waveform=False):
    from nptdms import ChannelObject, TdmsWriter

    mm = {"unit_string": "mm"}
    if waveform:
        x = {**mm, "wf_increment": 1e-3, "wf_start_offset": 0.0}
        u = {"unit_string": "V", "wf_increment": 1e-3, "wf_start_offset": 0.0}
        channels = [("x", 1e3 * X, x), ("u", U, u)]
    else:
        channels = [("time", TIME, {}), ("x", 1e3 * X, mm), ("u", U, {"unit_string": "V"})]
    with TdmsWriter(str(path)) as writer:
        writer.write_segment([ChannelObject("drive", n, v, p) for n, v, p in channels])
    return path


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


def write_hdf5(path):
    import h5py

    with h5py.File(path, "w") as file:
        file["about/serial"] = 7.0
        group = file.create_group("runs/one")
        group["time"], group["x"], group["u"] = TIME, 1e3 * X, U
        group["x"].attrs["unit"] = "mm"
    return path


def test_tdms_files_with_a_column_of_time_or_with_rates(tmp_path):
    is_given(read(write_tdms(tmp_path / "a.bin")))
    is_given(read(write_tdms(tmp_path / "b.tdms", waveform=True)))


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
    is_given(read(write_hdf5(tmp_path / "a.dat")))


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
def test_files_packed_again_and_again_are_refused(tmp_path):
    data = text()
    for _ in range(6):
        data = gzip.compress(data)
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(BadRecord, match="unpack it"):
        read(tmp_path / "a")


@pytest.mark.ci
def test_a_text_that_begins_as_a_format_does_is_a_text(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"LOGGER;7;8\nRIFF\n" + text())
    is_given(read(tmp_path / "a.csv"))
