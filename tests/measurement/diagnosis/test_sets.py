"""Probabilities of suspects: shares of one, by the utilities of their statistics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.measurement.diagnosis.sets import probabilities


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_probabilities_are_shares_of_one(count, seed):
    random = np.random.default_rng(seed)
    rows, weights = 100 * random.standard_normal((count, 4)), random.standard_normal(4)
    names = [f"n{k}" for k in range(count)]
    found = probabilities(names, rows, weights, {"n0": (3.0, 0.0, 0.0)})
    assert found.sum() == pytest.approx(1.0)
    assert np.all(found >= 0.0)


def test_odds_go_with_the_exponential_of_the_utility():
    rows = np.array([[1.0, 2.0, 0.5], [0.0, 1.0, 3.0]])
    own = {"b": (0.1, 0.2, -0.3)}  # a constant, and more of the last two
    found = probabilities(["a", "b"], rows, np.array([0.4, -0.2, 0.1]), own)
    utility = [0.4 - 0.4 + 0.05, -0.2 + 0.3 + 0.1 + 0.2 - 0.9]
    assert found[1] / found[0] == pytest.approx(np.exp(utility[1] - utility[0]))
