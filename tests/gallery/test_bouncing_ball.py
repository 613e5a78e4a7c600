"""The bouncing ball: its closed form, the table of the Reference-FMUs, and its end rule."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.gallery.bouncing_ball.findings import BALL
from ballscrew.gallery.finding import motion


def course(times, g=9.81, e=0.7, v_min=0.1, height=1.0):
    """Heights in closed form, flight by flight."""
    impact, speed = np.sqrt(2 * height / g), np.sqrt(2 * g * height)
    heights = height - g * times**2 / 2
    while (speed := e * speed) >= v_min:
        t = times - impact
        heights = np.where(t > 0, speed * t - g * t**2 / 2, heights)
        impact += 2 * speed / g
    return np.where(times >= impact, 0.0, heights), impact


@given(
    e=st.floats(0.0, 0.85), v_min=st.floats(0.02, 1.0), g=st.floats(1.0, 20.0), h=st.floats(0.1, 3)
)
@settings(max_examples=15, deadline=None, derandomize=True)
def test_the_course_is_that_of_the_closed_form(e, v_min, g, h):
    run = motion(BALL, 3.0, 0.02, {"e": e, "v_min": v_min, "g": g, "x_start": h})
    expected, end = course(run.time, g, e, v_min, h)
    np.testing.assert_allclose(run.outputs["x"], expected, atol=1e-11)
    rests = run.time > end + 1e-9
    assert np.all(run.outputs["x"][rests] == 0.0)
    assert np.all(run.outputs["v"][rests] == 0.0)
