"""Words for a body that turns."""

import pytest

from ballscrew.orchestration.loop.shown_units import in_turning_units

pytestmark = pytest.mark.ci


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
