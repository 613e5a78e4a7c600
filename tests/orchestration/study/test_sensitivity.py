"""Regression coefficients against those that the figures were made with."""

import numpy as np
import pytest

from ballscrew.orchestration.study.sensitivity import sensitivity


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


def test_a_figure_that_does_not_change_is_sensitive_to_nothing():
    found = sensitivity(np.random.default_rng(1).random((50, 2)), np.ones(50), ["a", "b"])
    assert found.foremost == ""


def test_what_is_not_linear_is_said_to_be_explained_badly():
    factors = np.linspace(-1, 1, 101)[:, None]
    found = sensitivity(factors, np.exp(factors[:, 0] ** 2), ["a"])
    assert found.explained == pytest.approx(0.0, abs=1e-9)
