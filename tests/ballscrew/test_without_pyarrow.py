"""Without pyarrow, tables are CSV, and a Parquet file is refused in one line."""

import subprocess
import sys

import numpy as np
import pytest

from ballscrew.solver import tables

BLOCKED = "import sys; sys.modules['pyarrow'] = None; "
MAP = (
    "map --controller pid --x plant.Fc=1:2:3 --y plant.Fs=2.2:3:2 --stop 0.5 --workers 1 --out"
).split()


def without_pyarrow(*words):
    command = f"{BLOCKED}from ballscrew.cli import main; sys.exit(main(sys.argv[1:]))"
    told = [sys.executable, "-c", command, *map(str, words)]
    return subprocess.run(told, capture_output=True, text=True)


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """The same map without and with pyarrow."""
    folder = tmp_path_factory.mktemp("maps")
    done = without_pyarrow(*MAP, folder / "without")
    assert (done.returncode, done.stderr) == (0, "")
    assert "map.csv, map.json" in done.stdout
    subprocess.run([sys.executable, "-m", "ballscrew", *MAP, folder / "with"], check=True)
    return folder


def test_a_map_is_a_csv_file_with_the_same_numbers(maps):
    assert {p.name for p in (maps / "without").glob("[!.]*")} == {
        "map.csv",
        "map.json",
        "map.png",
        "parameters.toml",
        "report.html",
    }
    assert not (maps / "with" / "map.csv").exists()
    text = tables.read_table(maps / "without" / "map.csv")
    assert text == tables.read_table(maps / "with" / "map.parquet")
    assert text["lambda1_bits_per_s"] == [None] * 6  # not asked for


def test_borders_are_found_in_a_finished_map_of_either_form(maps):
    done = without_pyarrow(*MAP, maps / "without", "--resume", "--refine")
    assert (done.returncode, done.stderr) == (0, "")
    done = without_pyarrow(*MAP, maps / "with", "--resume", "--refine")
    assert done.returncode == 2
    table = maps / "with" / "map.parquet"
    assert done.stderr == f"ballscrew: {table} {tables.PYARROW}\n"


def test_a_parquet_record_is_refused_in_one_line(tmp_path):
    (tmp_path / "run.parquet").write_bytes(b"PAR1\0")
    done = without_pyarrow("diagnose", tmp_path / "run.parquet", "--out", tmp_path / "out")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "run.parquet: is a Parquet file and needs pyarrow: pip install 'ballscrew[par" in line


def test_the_curves_of_a_diagnosis_are_a_csv_file(tmp_path):
    t = np.arange(0.0, 10.0, 2e-3)
    x = 0.02 * np.sin(0.7 * t) + 0.01 * np.sin(2.3 * t)
    v = np.gradient(x, t)
    table = np.column_stack([t, 3.0 * np.sign(v) + 40.0 * v, x])
    record = tmp_path / "axis.csv"
    np.savetxt(record, table, delimiter=",", header="time,u,x", comments="")
    done = without_pyarrow("diagnose", record, "--out", tmp_path / "out")
    assert done.returncode in (0, 1), done.stderr
    assert "curves.csv" in done.stdout
    curves = tables.read_table(tmp_path / "out" / "curves.csv")
    np.testing.assert_allclose(curves["time"], t, atol=1e-9)
    assert set(curves["telling"]) <= {True, False}


def test_a_table_that_lost_its_end_is_damaged(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1.5,x\n2.5")
    with pytest.raises(tables.BadTable, match=r"t\.csv is damaged"):
        tables.read_table(path)
