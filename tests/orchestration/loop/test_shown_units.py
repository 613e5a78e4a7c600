"""Units by the size of the numbers, and of a body that turns."""

import numpy as np
import pytest

from ballscrew.orchestration.loop.shown_units import (
    in_turning_units,
    labelled,
    length,
    quantity,
    shown_unit,
)

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


@pytest.mark.parametrize(
    ("slides", "turns"),
    [
        ("0.02 N rms of 4.6 N rms; 1.2 mm rms", "0.02 N*m rms of 4.6 N*m rms; 1.2 mrad"),
        ("sigma2   1.49955  1.4877 .. 1.5115     N*s/m", "N*m*s/rad"),
        ("m        0.499   0.49 .. 0.5     kg", "J        0.499   0.49 .. 0.5     kg*m^2"),
        ("0.3 m/s^2, 12 um.", "0.3 rad/s^2, 12 urad."),
    ],
)
def test_units_are_those_of_a_body_that_turns(slides, turns):
    assert turns in in_turning_units(slides)


@pytest.mark.parametrize(
    "text",
    [
        "the force comes later than the motion by 0.00709 ms (-0.55 .. 0.57)",
        "a record of 8 s, 1 kHz, 5 Nm.csv",
    ],
)
def test_all_else_stays_as_it_is(text):
    assert in_turning_units(text) == text
