"""Tuning on costs whose minima are known."""

import math

import pytest

from ballscrew.orchestration.study.tuning import tune

RANGES = {"a": (1e-2, 1e3), "b": (-5.0, 5.0)}
PUBLISHED = {"a": 100.0, "b": 0.0, "c": 7.0}


def bowl(values) -> float:
    """Smallest, 1, at a = 3, b = 2."""
    return 1 + math.log(values["a"] / 3) ** 2 + (values["b"] - 2) ** 2


def test_a_minimum_is_found_within_the_budget():
    found = tune(bowl, PUBLISHED, RANGES, 200, 1)
    assert found.cost == pytest.approx(1.0, abs=1e-2)
    assert found.values == {"a": pytest.approx(3, rel=0.1), "b": pytest.approx(2, abs=0.1)}
    assert found.doubled_cost <= found.cost
    assert found.tried == 400
    assert found.at_bound == ()


@pytest.mark.ci
@pytest.mark.parametrize("seed", range(5))
def test_tuned_is_never_worse_than_the_published_rule(seed):
    """Even with a budget of two on a cost that punishes every move."""
    found = tune(lambda v: 0.0 if v == PUBLISHED else 1.0 + v["a"], PUBLISHED, RANGES, 2, seed)
    assert found.cost == found.published_cost == 0.0
    assert found.values == {"a": 100.0, "b": 0.0}


def test_exactly_the_budget_decides_and_twice_as_many_are_tried():
    asked = []

    def cost(values) -> float:
        asked.append(dict(values))
        return bowl(values)

    found = tune(cost, PUBLISHED, RANGES, 17, 3)
    assert len(asked) == 34
    assert asked[0] == PUBLISHED
    assert all(v["c"] == 7.0 for v in asked)
    assert found.cost == min(map(bowl, asked[:17]))
    assert found.doubled_cost == min(map(bowl, asked))


def test_the_same_seed_gives_the_same_values_and_another_others():
    first, again, other = (tune(bowl, PUBLISHED, RANGES, 20, seed) for seed in (1, 1, 2))
    assert first == again
    assert first.values != other.values


def test_every_candidate_is_within_its_range_and_an_end_is_told():
    asked = []

    def cost(values) -> float:
        asked.append(values["b"])
        return -values["b"] + abs(math.log(values["a"]))

    found = tune(cost, PUBLISHED, RANGES, 150, 1)
    assert all(-5 <= b <= 5 for b in asked)
    assert found.at_bound == ("b",)


def test_one_parameter_alone_can_be_tuned():
    for seed in range(20):
        found = tune(lambda v: (v["b"] - 1) ** 2, PUBLISHED, {"b": (-5.0, 5.0)}, 100, seed)
        assert found.values["b"] == pytest.approx(1, abs=0.1)
