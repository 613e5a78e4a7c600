"""Balances in newtons: they tell what is left of a force, whatever a model makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.measurement.diagnosis.balance import leftovers
from ballscrew.measurement.diagnosis.motion import lay_along

pytestmark = pytest.mark.ci


FORCES = "kt m Jm sigma0 sigma1 sigma2 Fc Fs".split()


@pytest.fixture(scope="module")
def course():
    return lay_along(strong_record({"load": 0.4}), nominal())


def left(course, model):
    return leftovers([course], model)[0]


@settings(max_examples=20, deadline=None)
@given(st.floats(0.1, 10.0))
def test_a_model_of_forces_and_masses_that_are_all_larger_leaves_the_same(course, factor):
    model = nominal()
    larger = model.changed({n: factor * model.values[n] for n in FORCES})
    size = np.abs(left(course, model)).max()
    assert left(course, larger) == pytest.approx(left(course, model), abs=1e-6 * size)
