"""Cases: the same bytes from the same seed, usable records, nothing of the truth in the files."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from worlds import draw_case, write_case

SEED = 7
FIRST = ("fast_screw", "heavy_screw", "linear_drive", "industrial", "simulated")


of_the_cases = pytest.mark.xdist_group("worlds")  # which are drawn and compiled once


@pytest.fixture(scope="module")
def cases():
    """One case of each of the first worlds, each with another effect."""
    hidden = ("load_bias", "friction_drift", "direction_asymmetry", "backlash", "input_delay")
    return {w: draw_case(w, (name,), SEED) for w, name in zip(FIRST, hidden, strict=True)}


@pytest.mark.ci
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path):
    def written(seed, name):
        (folder := tmp_path / name).mkdir()
        paths, believed = write_case(draw_case("linear_drive", ("compliance",), seed), folder)
        return [p.read_bytes() for p in (*paths, believed)]

    first = written(SEED, "a")
    assert first == written(SEED, "b")
    assert first[0] != written(SEED + 1, "c")[0]


@pytest.mark.ci
@of_the_cases
def test_files_say_what_is_believed_and_nothing_of_the_truth(cases, tmp_path: Path):
    for world, case in cases.items():
        (folder := tmp_path / world).mkdir()
        (record,), believed = write_case(case, folder)
        assert sorted(p.name for p in folder.iterdir()) == ["believed.toml", "record.csv"]
        said = tomllib.loads(believed.read_text())
        assert set(said) == {"kind", "law", "plant"}
        for name, value in said["plant"].items():
            true = case.conditions.axis.values.get(name, 0.0)
            assert value == pytest.approx(true, rel=0.0301, abs=1e-12)
        header = record.read_text().splitlines()[0].split(",")
        assert header in (["time", "u", "x"], ["time", "u", "x", "i"])
        assert 2 <= len(case.wrong) <= 4 or not case.wrong
