"""Without pyarrow, tables are CSV; what needs a library that is not there says so in one line."""

import subprocess
import sys

import pytest

from ballscrew.cli import main
from ballscrew.solver import files

BLOCKED = "import sys; sys.modules['pyarrow'] = None; "
MAP = (
    "map --controller pid --x plant.Fc=1:2:3 --y plant.Fs=2.2:3:2 --stop 0.5 --workers 1 --out"
).split()


def without_pyarrow(*words):
    command = f"{BLOCKED}from ballscrew.cli import main; sys.exit(main(sys.argv[1:]))"
    told = [sys.executable, "-P", "-c", command, *map(str, words)]
    return subprocess.run(told, capture_output=True, text=True)


@pytest.mark.ci
def test_a_map_is_a_csv_file_with_the_same_numbers(tmp_path):
    done = without_pyarrow(*MAP, tmp_path / "without")
    assert (done.returncode, done.stderr) == (0, "")
    assert "map.csv, map.json" in done.stdout
    assert main([*MAP, str(tmp_path / "with")]) == 0
    assert not (tmp_path / "with" / "map.csv").exists()
    text = files.read_table(tmp_path / "without" / "map.csv")
    assert text == files.read_table(tmp_path / "with" / "map.parquet")
    assert text["lambda1_bits_per_s"] == [None] * 6  # not asked for
    done = without_pyarrow(*MAP, tmp_path / "with", "--resume")
    assert f"{tmp_path / 'with' / 'map.parquet'} {files.PYARROW}\n" in done.stderr


@pytest.mark.parametrize(
    ("first", "library", "said"),
    [
        (b"TDSm" + bytes(100), "nptdms", "is a TDMS file and needs nptdms: pip install 'ballscrew"),
        (b"PAR1\0", "pyarrow", "is a Parquet file and needs pyarrow: pip install 'ballscrew[par"),
    ],
)
def test_a_library_that_is_not_there_is_named_with_its_extra(
    tmp_path, monkeypatch, capsys, first, library, said
):
    (tmp_path / "run").write_bytes(first)
    monkeypatch.setitem(sys.modules, library, None)
    assert main(["diagnose", str(tmp_path / "run"), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
