"""Does a recorded condition explain the scatter over trials: against brute force, known tables."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from thesis_trials.scatter import explain_scatter

pytestmark = pytest.mark.ci


DATA = Path(__file__).resolve().parents[1] / "data"
DAHL, LUGRE = DATA / "table_2_5_dahl.csv", DATA / "table_2_9_lugre.csv"


def table(folder: Path, **columns: list[object]) -> Path:
    path = folder / "trials.csv"
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def between(y: np.ndarray, groups: list[object]) -> float:
    """Sum of squares of the groups' means, by hand."""
    means = {g: np.mean([v for v, h in zip(y, groups, strict=True) if h == g]) for g in groups}
    return float(sum((means[g] - np.mean(y)) ** 2 for g in groups))


def test_the_p_value_of_one_condition_is_that_of_all_permutations(tmp_path):
    y = np.random.default_rng(1).normal(size=7)
    side = ["a", "b", "a", "a", "b", "b", "a"]
    (found,) = explain_scatter(table(tmp_path, side=side, y=list(y)), "y").conditions
    all_of_them = [between(np.array(q), side) for q in itertools.permutations(y)]
    observed = between(y, side)
    assert found.exact
    assert found.assignments == 35
    assert found.share == pytest.approx(observed / float(((y - y.mean()) ** 2).sum()))
    assert found.p_value == pytest.approx(np.mean(np.array(all_of_them) >= observed - 1e-12))
    smallest = np.mean(np.array(all_of_them) >= max(all_of_them) - 1e-12)
    assert found.smallest_p == pytest.approx(smallest)


def test_with_another_condition_only_trials_alike_in_it_are_permuted(tmp_path):
    y = np.random.default_rng(2).normal(size=8)
    side, load = list("aabbaabb"), list("11112222")
    path = table(tmp_path, side=side, load=load, y=list(y))
    found = {c.name: c for c in explain_scatter(path, "y").conditions}["side"]

    def explained(first: tuple[float, ...], second: tuple[float, ...]) -> float:
        return between(np.array([*first, *second]), side)  # balanced: the load drops out

    halves = [list(itertools.permutations(h)) for h in (y[:4], y[4:])]
    everything = np.array([explained(f, s) for f in halves[0] for s in halves[1]])
    assert found.assignments == 36
    assert found.p_value == pytest.approx(np.mean(everything >= between(y, side) - 1e-12))


def test_a_condition_that_explains_is_found_and_one_that_does_not_is_not(tmp_path):
    random = np.random.default_rng(3)
    side, rate = [1, -1] * 8, [1, 1, 2, 2] * 4
    y = [10 + 2 * s + 0.5 * random.normal() for s in side]
    found = explain_scatter(table(tmp_path, side=side, rate=rate, y=y), "y")
    assert [c.name for c in found.conditions if c.explains] == ["side"]
    assert found.conditions[0].name == "side"
    assert found.conditions[0].difference == pytest.approx(4.0, abs=0.6)
    assert {v.label: v.trials for v in found.conditions[0].levels} == {"1": 8, "-1": 8}
    assert "not all scatter: side explains" in found.answer
    assert 0.85 < found.adjusted < found.explained < 1


def test_the_scatter_of_the_thesis_dahl_stiffness_goes_with_direction_and_frequency():
    found = explain_scatter(DAHL, "sigma_N_m")
    by_name = {c.name: c for c in found.conditions}
    assert set(by_name) == {"omega_rad_s", "direction"}
    assert all(c.explains and c.exact for c in by_name.values())
    assert by_name["omega_rad_s"].share == pytest.approx(0.444, abs=0.001)
    assert by_name["direction"].share == pytest.approx(0.279, abs=0.001)
    assert by_name["direction"].assignments == 6**4
    assert by_name["omega_rad_s"].assignments == 2520**2
    assert found.conditions[0].name == "omega_rad_s"
