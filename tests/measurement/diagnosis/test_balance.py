"""Balances in newtons: they tell what is left of a force, whatever a model makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.measurement.diagnosis.balance import Added, leftovers, responses, sensitivities
from ballscrew.measurement.diagnosis.causes import CAUSES
from ballscrew.measurement.diagnosis.motion import lay_along

pytestmark = pytest.mark.ci


FORCES = "kt m Jm sigma0 sigma1 sigma2 Fc Fs".split()


@pytest.fixture(scope="module")
def course():
    return lay_along(strong_record({"load": 0.4}), nominal())


def left(course, model):
    (found,) = leftovers([course], model, Added.nothing([course]))
    return found


@settings(max_examples=20, deadline=None)
@given(st.floats(0.1, 10.0))
def test_a_model_of_forces_and_masses_that_are_all_larger_leaves_the_same(course, factor):
    model = nominal()
    larger = model.changed({n: factor * model.values[n] for n in FORCES})
    size = np.abs(left(course, model)).max()
    assert left(course, larger) == pytest.approx(left(course, model), abs=1e-6 * size)


def test_a_cause_of_its_size_takes_away_what_is_left(course):
    shape = CAUSES["load_bias"].at([course], nominal(), {})
    (taken,) = responses([course], nominal(), shape)
    rest = left(course, nominal())[:, 0] - 0.4 * taken[:, 0, 0]
    assert np.sqrt(np.mean(rest**2)) < 0.2 * 0.4


def test_columns_of_values_are_the_slopes_of_what_is_left(course):
    model = nominal()
    law = [model.friction(course.x, course.v, course.step)]
    (columns,) = sensitivities([course], model, law)
    step = 1e-2
    for k, name in enumerate(model.adjustable):
        high, low = (
            left(course, model.changed({name: model.values[name] * (1 + s)})) for s in (step, -step)
        )
        slope = (low - high) / (2 * step)
        scale = np.abs(columns[:, :, k]).max()
        assert columns[:, :, k] == pytest.approx(slope, abs=0.02 * scale), name
