"""Cases: the same bytes from the same seed, usable records, nothing of the truth in the files."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from worlds import WORLDS, draw_case, effects_of, write_case
from worlds.friction_noise import KINDS, draw_noise
from worlds.instruments import CURRENTS, ENCODERS
from worlds.layout import TRAVEL, blank

SEED = 7
FIRST = ("fast_screw", "heavy_screw", "linear_drive", "industrial", "simulated")


of_the_cases = pytest.mark.xdist_group("worlds")  # which are drawn and compiled once


@pytest.fixture(scope="module")
def cases():
    """One case of each of the first worlds, each with another effect."""
    hidden = ("load_bias", "friction_drift", "direction_asymmetry", "backlash", "input_delay")
    return {w: draw_case(w, (name,), SEED) for w, name in zip(FIRST, hidden, strict=True)}


def test_there_are_four_worlds_or_more_and_six_effects_outside():
    assert len(WORLDS) >= 4
    for world in set(WORLDS) - {"wrong_scales"}:
        causes, outside, _ = effects_of(world)
        assert len(causes) >= 15
        assert len(outside) >= 6


@of_the_cases
def test_records_move_both_ways_and_stay_in_range(cases):
    for case in cases.values():
        x, half = case.record["x"], case.conditions.axis.travel
        steps = np.diff(x)
        assert np.all(np.isfinite(x))
        assert np.abs(x).max() < 1.2 * half
        assert min((steps > 0).sum(), (steps < 0).sum()) > 50
        assert np.ptp(case.record["u"]) > 0
        assert 8 <= case.record["time"][-1] + 1e-2 <= 30.1


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path):
    def written(seed, name):
        (folder := tmp_path / name).mkdir()
        paths, believed = write_case(draw_case("linear_drive", ("compliance",), seed), folder)
        return [p.read_bytes() for p in (*paths, believed)]

    first = written(SEED, "a")
    assert first == written(SEED, "b")
    assert first[0] != written(SEED + 1, "c")[0]


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


def test_the_truth_says_more_of_a_larger_effect():
    """A load of all of the friction shows at a ratio of 50 or more, a smaller one by its share."""
    found = [draw_case("linear_drive", ("load_bias",), seed) for seed in range(2)]
    sizes = [abs(c.effects[0].truth.get("load", 0)) / c.conditions.axis.values["Fc"] for c in found]
    assert all(c.sights[0].ratio > 50 * size for c, size in zip(found, sizes, strict=True))
    assert draw_case("linear_drive", (), SEED).sights == ()


@pytest.mark.parametrize("kind", KINDS)
def test_friction_noise_has_the_size_that_is_asked_for(kind):
    axis = blank()
    axis[TRAVEL] = 0.1
    noise, texture, growth = draw_noise(np.random.default_rng(1), kind, 0.05, axis, 40000, 1e-3)
    spread = np.std(texture.tables[0]) if kind.startswith("texture") else np.std(noise[:, 0])
    assert spread == pytest.approx(0.0 if kind == "none" else 0.05, rel=0.3)
    assert (growth > 0) == (kind == "growing_with_speed")


def test_unknown_names_are_told():
    with pytest.raises(ValueError, match="expected one of fast_screw"):
        draw_case("moon", (), 0)
    with pytest.raises(ValueError, match="expected one of direction_asymmetry"):
        draw_case("fast_screw", ("rust",), 0)
    with pytest.raises(ValueError, match="expected one of none, white"):
        draw_noise(np.random.default_rng(1), "pink", 0.05, blank(), 10, 1e-3)


def test_every_instrument_of_the_list_is_in_some_world():
    drawn = [WORLDS[w](np.random.default_rng(k)) for w in WORLDS for k in range(5)]
    assert {e for c in drawn for e in c.encoders} == set(ENCODERS)
    assert {i for c in drawn for i in c.currents} == set(CURRENTS)
    assert {c.noise for w in WORLDS for k in range(40)
            for c in [WORLDS[w](np.random.default_rng(k))]} == set(KINDS)  # fmt: skip
