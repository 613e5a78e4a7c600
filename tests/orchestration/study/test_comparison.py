"""Who can be told apart: rates over random figures of known ratio."""

import numpy as np
import pytest

from ballscrew.orchestration.study.comparison import compare


def drawn(random, ratio, seeds=3, plants=20, tuning=0.01, own=0.02):
    """Two controllers on the same plants, whose own spread of 30 % both share."""
    shared = random.normal(0, 0.3, plants)

    def side(level):
        of_seed = random.normal(0, tuning, (seeds, 1))
        return np.exp(level + shared + of_seed + random.normal(0, own, (seeds, plants)))

    return side(np.log(ratio)), side(0.0)


def rate(ratio, count=400, **spread) -> float:
    random = np.random.default_rng(1)
    return np.mean([compare(*drawn(random, ratio, **spread)).told_apart for _ in range(count)])


def test_equal_controllers_are_seldom_told_apart():
    assert rate(1.0) <= 0.05  # one in ten is allowed


def test_one_that_is_a_tenth_worse_is_mostly_told_apart():
    assert rate(1.1) >= 0.8


def test_the_luck_of_the_tuning_is_no_difference():
    """Tunings that spread by 10 %: equal controllers stay equal."""
    assert rate(1.0, tuning=0.1) <= 0.06


def test_the_interval_holds_the_ratio_as_often_as_it_says():
    random = np.random.default_rng(2)
    found = [compare(*drawn(random, 1.3)) for _ in range(400)]
    assert np.mean([d.low <= 1.3 <= d.high for d in found]) >= 0.88


def test_the_same_figures_are_equal_and_the_order_turns_the_ratio_over():
    random = np.random.default_rng(3)
    a, b = drawn(random, 1.5)
    same = compare(a, a)
    assert same.ratio == 1.0
    assert not same.told_apart
    there, back = compare(a, b), compare(b, a)
    assert there.ratio == pytest.approx(1 / back.ratio)
    assert there.low == pytest.approx(1 / back.high)


def test_a_difference_below_two_percent_matters_to_nobody():
    steady = np.full((3, 20), 1.0)
    assert not compare(1.01 * steady, steady).told_apart
    assert compare(1.03 * steady, steady).told_apart
