"""Does a recorded condition explain the scatter over trials: against brute force, known tables."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from thesis_trials.scatter import BadTable, explain_scatter

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


def test_mere_scatter_is_called_explained_as_seldom_as_said(tmp_path):
    random, called = np.random.default_rng(4), 0
    for _ in range(400):
        path = table(
            tmp_path, side=[1, -1] * 6, load=[1, 1, 2, 2, 3, 3] * 2, y=list(random.normal(size=12))
        )
        called += any(c.explains for c in explain_scatter(path, "y").conditions)
    assert called / 400 < 0.05 + 2 * np.sqrt(0.05 * 0.95 / 400)


def test_more_assignments_than_can_be_counted_are_sampled_with_a_stated_resolution(tmp_path):
    y = list(np.random.default_rng(5).normal(size=24))
    (found,) = explain_scatter(table(tmp_path, side=[1, -1] * 12, y=y), "y").conditions
    assert not found.exact
    assert found.smallest_p == 1 / (found.assignments + 1)
    assert found.p_value > found.smallest_p


def test_columns_that_divide_the_trials_alike_are_one_condition(tmp_path):
    path = table(
        tmp_path,
        rate=[1, 1, 2, 2, 3, 3],
        seconds=[9, 9, 4, 4, 3, 3],
        number=[1, 2, 3, 4, 5, 6],
        load=[5] * 6,
        y=[1.0, 1.2, 2.1, 1.9, 3.2, 3.0],
    )
    found = explain_scatter(path, "y")
    assert [(c.name, c.same_as) for c in found.conditions] == [("rate", ("seconds",))]
    assert set(found.no_conditions) == {"seconds", "number", "load"}


def test_what_the_trials_cannot_tell_is_said(tmp_path):
    path = table(tmp_path, side=[1, 1, -1, -1], y=[1.0, 1.1, 2.0, 2.1])
    found = explain_scatter(path, "y")
    (side,) = found.conditions
    assert side.smallest_p == pytest.approx(1 / 3)
    assert not side.explains
    assert not side.can_tell
    assert "4 trials cannot tell about side" in found.answer


def test_trials_without_the_value_are_left_out_and_counted(tmp_path):
    y = [1.0, "", 1.1, 2.0, 2.2, 2.1, "", 0.9]
    found = explain_scatter(table(tmp_path, side=[1, 1, 1, 2, 2, 2, 2, 1], y=y), "y")
    assert (found.trials, found.left_out) == (6, 2)


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


def test_the_scatter_of_the_thesis_coulomb_force_shows_no_condition():
    found = explain_scatter(DAHL, "Fc_N")
    assert all(c.can_tell and not c.explains for c in found.conditions)


def test_six_trials_of_the_thesis_lugre_stiffness_cannot_tell_about_force():
    (force,) = explain_scatter(LUGRE, "sigma0_N_m").conditions
    assert force.smallest_p == pytest.approx(1 / 15)
    assert force.share < 0.01
    assert not force.can_tell


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("side,y\n1,2\n", "1 trials have"),
        ("side,y\n", "1 lines"),
        ("side,z\n1,2\n1,2\n2,3\n2,3\n", "no column 'y'; there are side, z"),
        ("side,y\n1,2\n1,2\n2,2\n2,2\n", "no scatter"),
        ("side,y\n1,2\n1,two\n2,3\n2,3\n", "'two' in a row, expected a number"),
        ("side,y\n1,2\n1\n2,3\n2,3\n", "row 3 has 1 cells, expected 2"),
        ("y,y\n1,2\n", "two columns are named 'y'"),
    ],
)
def test_a_table_that_cannot_be_asked_is_refused_in_one_line(text, says, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(BadTable) as refused:
        explain_scatter(path, "y")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_table_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(BadTable, match="cannot be read"):
        explain_scatter(tmp_path / "none.csv", "y")
