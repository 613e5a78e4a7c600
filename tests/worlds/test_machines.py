"""Worlds after machines in use, wrong signals, and more records of a machine."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from worlds import SIGNALS, draw_case, write_case
from worlds.records import make_record
from worlds.signals import spoilt

# the simulators are compiled once
pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("worlds")]

HIDDEN = {
    "heavy_friction": "parameter_error",
    "slow_noise": "load_bias",
    "jittered": "scale_of_x",
    "one_way": "load_bias",
    "geared_joint": "unmodelled_inertia",
    "low_sampling": "direction_asymmetry",
    "warming": "friction_drift",
    "held_back_lead_screw": "sign_of_u",
    "held_back_gantry": "time_shift",
    "wrong_scales": "scale_of_i",
}
SEED = 1
OTHERS = sorted(HIDDEN.keys() - {"heavy_friction", "geared_joint"})
SAMPLE = [*HIDDEN][:5:4] + [pytest.param(w, marks=pytest.mark.prove) for w in OTHERS]


@pytest.fixture(scope="module")
def drawn():
    """A case of a world, faultless or with its effect, drawn once when it is first asked for."""
    return functools.cache(lambda world, *effects: draw_case(world, effects, SEED))


@pytest.fixture
def hidden(drawn):
    return lambda world: drawn(world, HIDDEN[world])


@pytest.mark.parametrize("world", SAMPLE)
def test_a_world_draws_a_faultless_case_in_which_nothing_is_seen(drawn, world):
    case = drawn(world)
    assert case.effects == case.sights == ()
    assert max(case.law_ratio, case.tolerated_ratio) < 3
    for record in case.records:
        assert {len(column) for column in record.values()} == {len(record["x"])}
        assert all(np.all(np.isfinite(column)) for column in record.values())
        assert np.abs(record["x"]).max() < 1.2 * case.conditions.axis.travel
        assert np.ptp(record["x"]) > 1e-4
        assert np.ptp(record["u"]) > 0
        assert np.all(np.diff(record["time"]) > 0)


def test_all_records_of_a_case_are_written_and_the_same_ones_for_the_same_seed(drawn, tmp_path):
    files = []
    for name, case in (("a", drawn("one_way")), ("b", draw_case("one_way", (), SEED))):
        (folder := tmp_path / name).mkdir()
        paths, believed = write_case(case, folder)
        assert [p.name for p in paths] == ["record.csv", "record_2.csv"]
        files.append([p.read_bytes() for p in (*paths, believed)])
    assert files[0] == files[1]


def test_one_record_goes_forwards_and_one_backwards(hidden):
    first, second = (record["x"] for record in hidden("one_way").records)
    assert first[-1] - first[0] > 0.9 * np.ptp(first)
    assert second[0] - second[-1] > 0.9 * np.ptp(second)


def test_stamps_jitter_by_as_much_as_the_world_says(drawn):
    case = drawn("jittered")
    period, time = case.conditions.sampling, case.record["time"]
    off = (time - np.arange(time.size) * period) / period
    assert np.std(off) == pytest.approx(case.conditions.jitter, rel=0.1)
    # where it moves fast, its speed is even by the stamps and not by the count
    steps = np.diff(drawn("jittered").record["x"])
    fast = np.abs(steps)[1:] > 0.5 * np.abs(steps).max()
    by_stamps, by_count = (np.std(np.diff(steps / dt)[fast]) for dt in (np.diff(time), period))
    assert by_stamps < 0.6 * by_count


def test_wrong_columns_are_the_right_ones_times_the_factor(hidden):
    case = hidden("wrong_scales")
    (scene,), factor = case.scenes, case.effects[0].truth["factor"]
    right, _ = make_record(scene, scene.run({}, 0.0, clean=False), {})
    assert case.record["i"] == pytest.approx(factor * right["i"])
    assert np.array_equal(case.record["x"], right["x"])
    rng, record = (
        np.random.default_rng(4),
        {n: np.arange(1.0, 101.0) for n in ("time", "u", "x", "i")},
    )
    for name, column in (("scale_of_u", "u"), ("scale_of_i", "i"), ("scale_of_x", "x"),
                         ("sign_of_u", "u"), ("sign_of_x", "x")):  # fmt: skip
        effect = SIGNALS[name](rng, None)
        found = spoilt(record, (effect,))
        assert found[column] == pytest.approx(effect.truth["factor"] * record[column])
        assert all(np.array_equal(found[n], record[n]) for n in record if n != column)
