"""Units by the size of the numbers."""

import numpy as np
import pytest

from ballscrew.orchestration.loop.shown_units import labelled, length, quantity, shown_unit

pytestmark = pytest.mark.ci


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.08, "m", "80 mm"),
        (-1e-3, "m", "-1 mm"),
        (9.99e-4, "m", "999 µm"),
        (4.78186e-11, "m", "0.0478186 nm"),
        (0.058, "m*s", "58 mm*s"),
        (3e-6, "rad", "3 µrad"),
        (1e-3, "V", "0.001 V"),
        (1e-3, "m^2", "0.001 m^2"),
        (0.5, "1", "0.5"),
        (None, "m", "-"),
    ],
)
def test_a_number_gets_the_unit_that_suits_it(value, unit, text):
    assert quantity(value, unit) == text
    assert length(-1.23456e-3) == "-1.23 mm"


def test_the_largest_number_decides_and_what_is_not_finite_does_not_count():
    assert shown_unit([1e-6, -0.02, np.inf, np.nan], "m") == (1e3, "mm")
    assert shown_unit([], "m") == (1.0, "m")
    assert labelled("error", "") == "error"
