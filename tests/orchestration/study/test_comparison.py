"""Means over plants and who can be told apart: rates over random figures of known laws;
what an error depends on."""

import numpy as np
import pytest

from ballscrew.orchestration.study.statistics import compare, mean_over_plants, sensitivity

pytestmark = pytest.mark.ci


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


def test_nothing_is_equal_that_its_interval_does_not_show_to_be():
    """Two tunings of each, of which one failed: a ratio of a hundred, and nothing is known."""
    good, failed = np.full((2, 8), 6.78e-5), np.full((2, 8), 6.78e-5)
    failed[1] *= 1e4
    found = compare(failed, good)
    assert found.ratio == pytest.approx(100.0)
    assert found.words == "these runs cannot tell"
    assert compare(1.01 * good, good).words == "equal within 10 %"
    assert compare(1.03 * good, good).words == "different"
    random = np.random.default_rng(5)
    alike = np.mean([compare(*drawn(random, 1.12)).alike for _ in range(400)])
    assert alike <= 0.05  # a twelfth more is seldom shown to be less than a tenth


@pytest.mark.parametrize("geometric", [True, False])
@pytest.mark.parametrize("plants", [5, 20])
def test_the_interval_of_a_mean_holds_that_of_its_law_in_nine_of_ten_studies(geometric, plants):
    """Normal, and log-normal with a spread of 50 %: Student's interval is exact. 2000 studies
    are within 2 % of it but for three in a thousand."""
    random = np.random.default_rng(4)
    held = 0
    for _ in range(2000):
        drawn = random.normal(1.3, 0.5, (1, plants))
        found = mean_over_plants(np.exp(drawn) if geometric else drawn, geometric)
        truth = np.exp(1.3) if geometric else 1.3
        assert found.low < found.mean < found.high
        held += found.low <= truth <= found.high
    assert held / 2000 == pytest.approx(0.9, abs=0.02)


def test_tunings_on_a_plant_are_averaged_and_the_mean_is_that_of_all_runs():
    figure = np.array([[1.0, 4.0, 2.0], [9.0, 1.0, 2.0]])
    plain, geometric = (mean_over_plants(figure, kind) for kind in (False, True))
    assert plain.mean == pytest.approx(figure.mean())
    assert geometric.mean == pytest.approx(np.exp(np.log(figure).mean()))
    # plants 5, 2.5, 2: a deviation of 1.6073, and 2.92 of Student's table at 2 degrees
    assert plain.high - plain.mean == pytest.approx(2.91999 * 1.607275 / np.sqrt(3), rel=1e-5)


def test_a_figure_that_a_run_does_not_have_has_no_mean_and_one_that_is_always_equal_no_width():
    assert np.isnan(mean_over_plants(np.array([[1.0, np.inf, 2.0]]), False).mean)
    steady = mean_over_plants(np.full((2, 4), 3.0), True)
    assert (steady.low, steady.high) == pytest.approx((3.0, 3.0))


def test_coefficients_are_those_of_the_linear_law():
    random = np.random.default_rng(1)
    factors = random.random((4000, 3))
    log = 3 * factors[:, 0] - 4 * factors[:, 1]
    found = sensitivity(factors, np.exp(log), ["a", "b", "c"])
    assert found.coefficients == {
        "a": pytest.approx(0.6, abs=0.02),
        "b": pytest.approx(-0.8, abs=0.02),
        "c": pytest.approx(0.0, abs=0.02),
    }
    assert found.explained == pytest.approx(1.0, abs=1e-6)
    assert found.foremost == "b"


def test_what_is_not_linear_is_said_to_be_explained_badly():
    factors = np.linspace(-1, 1, 101)[:, None]
    found = sensitivity(factors, np.exp(factors[:, 0] ** 2), ["a"])
    assert found.explained == pytest.approx(0.0, abs=1e-9)
