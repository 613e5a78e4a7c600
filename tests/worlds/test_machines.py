"""Worlds after machines in use, wrong signals, and what the worlds import."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import numpy as np
import pytest
import worlds
from worlds import draw_case, write_case
from worlds.scenes import make_record

# the simulators are compiled once
pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("worlds")]

SEED = 1
OTHERS = (
    "slow_noise", "jittered", "one_way", "low_sampling", "warming", "held_back_lead_screw",
    "held_back_gantry", "wrong_scales",
)  # fmt: skip
SAMPLE = ["heavy_friction", "geared_joint"]
SAMPLE += [pytest.param(world, marks=pytest.mark.prove) for world in OTHERS]


@pytest.fixture(scope="module")
def drawn():
    """A case of a world, faultless or with its effect, drawn once when it is first asked for."""
    return functools.cache(lambda world, *effects: draw_case(world, effects, SEED))


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


def test_both_records_of_a_case_are_written_and_the_same_ones_for_the_same_seed(drawn, tmp_path):
    files = []
    for name, case in (("a", drawn("one_way")), ("b", draw_case("one_way", (), SEED))):
        (folder := tmp_path / name).mkdir()
        paths, believed = write_case(case, folder)
        assert [p.name for p in paths] == ["record.csv", "record_2.csv"]
        files.append([p.read_bytes() for p in (*paths, believed)])
    assert files[0] == files[1]
    first, second = (record["x"] for record in drawn("one_way").records)
    assert first[-1] - first[0] > 0.9 * np.ptp(first)
    assert second[0] - second[-1] > 0.9 * np.ptp(second)


def test_stamps_jitter_by_as_much_as_the_world_says(drawn):
    case = drawn("jittered")
    period, time = case.conditions.sampling, case.records[0]["time"]
    off = (time - np.arange(time.size) * period) / period
    assert np.std(off) == pytest.approx(case.conditions.jitter, rel=0.1)
    # where it moves fast, its speed is even by the stamps and not by the count
    steps = np.diff(case.records[0]["x"])
    fast = np.abs(steps)[1:] > 0.5 * np.abs(steps).max()
    by_stamps, by_count = (np.std(np.diff(steps / dt)[fast]) for dt in (np.diff(time), period))
    assert by_stamps < 0.6 * by_count


@pytest.mark.parametrize(("effect", "column"), [("scale_of_i", "i"), ("sign_of_x", "x")])
def test_a_wrong_column_is_the_right_one_times_the_factor(drawn, effect, column):
    case = drawn("wrong_scales", effect)
    (scene,), (hidden,) = case.scenes, case.effects
    right, _ = make_record(scene, scene.motion, {})
    assert case.records[0][column] == pytest.approx(hidden.factors[column] * right[column])
    for other in right.keys() - {column}:
        assert np.array_equal(case.records[0][other], right[other])


def test_the_worlds_import_numerical_libraries_and_nothing_of_the_program_that_they_judge():
    found = set()
    for path in Path(worlds.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add((node.module or "").split(".")[0])
            assert not (isinstance(node, ast.Name) and node.id in ("__import__", "importlib"))
    of_python = (
        "__future__ collections dataclasses functools getpass hashlib math os pathlib tempfile"
    )
    assert found <= {*of_python.split(), "typing", "zlib", "numba", "numpy", "scipy", "worlds"}
