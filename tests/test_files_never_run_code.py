"""No record, table, parameter file or other file of numbers runs code, whatever it holds."""

import bz2
import gzip
import json
import lzma
import os
import pickle
import tracemalloc
import zipfile

import numpy as np
import pytest
import scipy.io

from ballscrew.cli import main
from ballscrew.measurement.records import formats
from ballscrew.measurement.records.columns import MOST
from ballscrew.solver.errors import BadRecord

T = np.arange(50) / 100


class Bomb:
    def __init__(self, code):
        self.code = code

    def __reduce__(self):
        return exec, (self.code,)


def mdf(version):
    def write(path, code):
        from asammdf import MDF, Signal

        place = "+".join(f"chr({ord(letter)})" for letter in code)  # the library changes an x
        formula = f"2*X1+__import__('os').mkdir({place})"
        with MDF(version=version) as file:
            force = Signal(T, T, name="force", unit="N", conversion={"formula": formula})
            file.append([force, Signal(T, T, name="x", unit="m")])
            file.save(path.with_suffix(".mdf"), overwrite=True).rename(path)

    return write


def npz(path, code):
    with path.open("wb") as stream:
        np.savez(stream, time=T, force=np.array([Bomb(f"import os; os.mkdir({code!r})")]))


def pickled(path, code):
    path.write_bytes(pickle.dumps(Bomb(f"import os; os.mkdir({code!r})")))


def formulas(path, code):
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["time", "force", "x"])
    for t in T:
        book.active.append([t, f"=__import__('os').mkdir({code!r})", t])
    book.save(path)


def csv(path, code):
    rows = "".join(f"{t},__import__('os').mkdir({code!r}),0\n" for t in T)
    path.write_text(f"time,force,x\n{rows}")


RECORDS = {"arrays of objects": npz, "a pickle": pickled, "words in a table": csv}
MORE_RECORDS = {"MDF 4": mdf("4.10"), "MDF 3": mdf("3.30"), "a workbook with formulas": formulas}


@pytest.mark.parametrize(
    "write",
    [*RECORDS.values(), *(pytest.param(w, marks=pytest.mark.ci) for w in MORE_RECORDS.values())],
    ids=[*RECORDS, *MORE_RECORDS],
)
def test_a_record_runs_no_code(write, tmp_path, capsys):
    path, mark = tmp_path / "record", tmp_path / "mark"
    write(path, str(mark))
    assert main(["identify", str(path), "--law", "dahl", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not mark.exists()


EVIL = """from pathlib import Path
Path(__file__).with_name("mark").touch()
def pi(): ...
"""
PARAMETERS = (
    'kind = "evil.py:pi"',
    'kind = "drive"\nlaw = "evil.py:pi"',
    'kind = "drive"\ncommand = "evil.py:pi"',
    'kind = "fmu"\n[plant]\n"evil.py:pi" = 1.0',
    '[controller."evil.py:pi"]\nKp = 1.0',
    "[plant]\nm = \"__import__('os').mkdir('mark')\"",
    "[plant]\nm = {value = \"open('mark', 'w')\", source = \"{evil}\"}",
)


@pytest.mark.parametrize(
    "command",
    [
        "run --controller pid --stop 0.01 --step 1e-3",
        pytest.param("tune --controller pid", marks=pytest.mark.ci),
        pytest.param("export --only pid", marks=pytest.mark.ci),
    ],
)
def test_a_parameter_file_runs_no_code(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "evil.py").write_text(EVIL)
    for text in PARAMETERS:
        (tmp_path / "p.toml").write_text(f'format = "ballscrew-parameters 1"\n{text}\n')
        main([*command.split(), "--params", "p.toml", "--out", "out"])
        capsys.readouterr()
        assert not (tmp_path / "mark").exists()
    # the name is code where it is asked for: else this would prove nothing
    main(["run", "--controller", "evil.py:pi", "--out", "other"])
    assert (tmp_path / "mark").exists()


@pytest.mark.ci
@pytest.mark.parametrize("packed", [gzip.compress, bz2.compress, lzma.compress, "zip"])
def test_a_small_record_that_unpacks_to_much_is_refused(packed, tmp_path, monkeypatch):
    monkeypatch.setitem(MOST, "bytes when unpacked", 10_000)
    path, text = tmp_path / "record", b"0" * 20_000
    if packed == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("record.csv", text)
    else:
        path.write_bytes(packed(text))
    with pytest.raises(BadRecord, match="bytes when unpacked, expected at most 10000"):
        formats.tables_in(path, path.read_bytes())


def many_rows(path):
    import pyarrow
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({"time": np.zeros(MOST["rows"] + 1)}), path)


def many_cells(path):
    import h5py

    with h5py.File(path, "w") as file:  # not written: nothing on disk
        file.create_dataset("time", (MOST["cells"] + 1,), float, compression="gzip")


def packed_structure(path):
    zeros = {"a": np.zeros(MOST["bytes when unpacked"] // 8)}
    scipy.io.savemat(path, {"s": zeros}, do_compression=True, appendmat=False)


@pytest.mark.parametrize("write", [many_rows, many_cells, packed_structure])
def test_a_small_file_of_large_arrays_is_refused_before_they_are_made(write, tmp_path, monkeypatch):
    monkeypatch.setitem(MOST, "bytes when unpacked", 10_000_000)
    path = tmp_path / "record"
    write(path)
    assert path.stat().st_size < 1_000_000
    tracemalloc.start()
    with pytest.raises(BadRecord, match=r"rows, expected|cells, expected|unpacked, expected"):
        formats.tables_in(path, path.read_bytes())
    assert tracemalloc.get_traced_memory()[1] < 30_000_000
    tracemalloc.stop()


def elsewhere(way, file, other, raw):
    """Put into an HDF5 file what has its numbers in another."""
    import h5py

    if way == "link":
        file["linked"] = h5py.ExternalLink(str(other), "/secret")
    elif way == "link to a link":
        file["a"] = h5py.ExternalLink(str(other), "/secret")
        file["linked"] = h5py.SoftLink("/a")
    elif way == "itself":
        file["linked"] = np.arange(50.0)
    elif way == "raw":
        file.create_dataset("linked", (50,), float, external=[(str(raw), 0, 400)])
    else:
        layout = h5py.VirtualLayout((50,), float)
        layout[:] = h5py.VirtualSource(str(other), "secret", (50,))
        file.create_virtual_dataset("linked", layout)


@pytest.mark.parametrize("way", ["link", "link to a link", "raw", "virtual", "itself"])
def test_a_record_in_hdf5_reads_no_other_file(way, tmp_path):
    """Two of them are files of MATLAB, too. What is in the file itself is read."""
    import h5py

    matlab = way in ("link to a link", "virtual")
    other, raw, path = (tmp_path / name for name in ("other.h5", "secret", "record"))
    raw.write_bytes(np.arange(50.0).tobytes())
    with h5py.File(other, "w") as file:
        file["secret"] = np.arange(50.0)
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        file["time"] = T
        elsewhere(way, file, other, raw)
    if matlab:
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    try:
        tables = formats.tables_in(path, path.read_bytes())
    except BadRecord:
        return
    seen = any(np.any(c[1:] >= 1) for t in tables for c in t.columns.values())
    assert seen == (way == "itself")


@pytest.mark.ci
def test_parts_of_long_work_are_numbers(tmp_path):
    """What --resume goes on with is JSON: a pickle in its place is no part of it."""
    from ballscrew.orchestration.study.workers import KeptParts

    mark = str(tmp_path / "mark")
    parts = KeptParts(tmp_path / "parts", "digest")
    parts.write("done.json", [1.0])
    assert json.loads((tmp_path / "parts" / "done.json").read_text())["found"] == [1.0]
    (tmp_path / "parts" / "done.json").write_bytes(
        pickle.dumps(Bomb(f"import os; os.mkdir({mark!r})"))
    )
    assert parts.read("done.json") is None
    assert not os.path.exists(mark)
