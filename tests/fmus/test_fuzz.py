"""A sample of the proof in proofs/fuzz.py: damaged and hostile files, from reading to running."""

import pytest
from fuzz import DESCRIPTIONS, good_files, mutated, trial

from ballscrew.fmus.reading import unpack
from ballscrew.fmus.system_reading import read_system
from ballscrew.solver.errors import FmuError

FILES = 300

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def good():
    return good_files()


def test_damaged_files_are_read_or_refused_and_nothing_lands_beside_them(
    good, tmp_path, monkeypatch
):
    (tmp_path / "in" / "tmp").mkdir(parents=True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "in" / "tmp"))
    refused = 0
    for seed in range(FILES):
        suffix = "ssp" if seed % 5 == 0 else "fmu"
        path = tmp_path / "in" / f"bad.{suffix}"
        path.write_bytes(mutated(good[suffix], DESCRIPTIONS[suffix], seed)[1])
        try:
            (read_system if suffix == "ssp" else unpack)(path).remove()
        except FmuError as error:
            refused += 1
            named = str(error).startswith(str(path))
        else:
            named = True
        assert named, seed
        assert not list((tmp_path / "in" / "tmp").iterdir()), seed
    assert {p.name for p in tmp_path.iterdir()} == {"in"}
    assert {p.name for p in (tmp_path / "in").iterdir()} == {"tmp", "bad.fmu", "bad.ssp"}
    assert 0.25 * FILES < refused < 0.95 * FILES  # the mutations neither all miss nor all kill


def test_damaged_files_bring_no_traceback_no_hang_and_one_line(good, tmp_path):
    files = {suffix: tmp_path / f"good.{suffix}" for suffix in good}
    for suffix, path in files.items():
        path.write_bytes(good[suffix])
    rows = [trial(seed, files) for seed in range(2004, 2014)]
    assert [r for r in rows if r["complaint"]] == []
    assert {r["code"] for r in rows} >= {0, 2}
