"""Which law shows which feature; the criteria on laws made for them are proofs/criteria.py."""

import math

import numpy as np
import pytest
from features.table import feature_table
from synthetic import laws as synthetic

pytestmark = pytest.mark.prove


@pytest.fixture
def made(once):
    """Decisions on the synthetic laws; each is in the list only while it runs."""
    return lambda what: once(what, lambda: synthetic.judged(what))


def test_the_lag_that_is_found_is_the_one_built_in(made):
    """First-order memory of velocity: c (v - v_before) is c w T/(1 + (w T)^2) times the cosine."""
    c, w, lag = 200.0, 3.0, 0.1
    quadrature = c * 1e-3 * w * lag / (1 + (w * lag) ** 2)
    width = made("frictional memory alone")["friction_lag"].checks[0].measure
    assert width == pytest.approx(quadrature * math.pi / 2, rel=0.02)


# -- the laws themselves -----------------------------------------------------------------------


of_the_table = pytest.mark.xdist_group("laws_table")  # nobody waits for who makes it


@pytest.fixture(scope="module")
def table(once):
    return once("table of all laws", lambda: feature_table(processes=2))


@of_the_table
def test_lugre_moves_before_sliding_as_its_equations_say(table):
    """Loaded slowly, x = -Fs/sigma0 ln(1 - F/Fs): 13, 31 and 60 % beyond F/sigma0."""
    seen = table.observations["lugre"]
    fs, sigma0 = 2.35, 66967.231
    force, x = (a[seen.hold_ends] for a in (seen.staircase.force, seen.staircase.x))
    np.testing.assert_allclose(x, -fs / sigma0 * np.log(1 - force / fs), rtol=0.02)
