"""Bliman-Sorine friction with row 6 of Table 2.7 against the solution of its equations."""

import numpy as np
import pytest
from prescribed_motion import prescribed_friction, ways

F1, F2, EPS, ETA = 19.875, 17.8227, 0.000121, 0.9063


def along(length, speed=1e-3, points=20001):
    grid = np.linspace(0, length / speed, points)
    return prescribed_friction(
        "bliman_sorine", grid, np.full(points, speed), tolerance=1e-10
    ).outputs


def test_friction_from_rest_is_the_sum_of_two_exponentials():
    got = along(1.5e-3, points=301)
    x = got["x"]
    exact = F1 * (1 - np.exp(-x / (ETA * EPS))) - F2 * (1 - np.exp(-x / EPS))
    np.testing.assert_allclose(got["friction"], exact, atol=1e-7)


def test_the_peak_after_a_reversal_is_the_one_that_the_map_of_eq_2_8_takes():
    grid = np.linspace(0, 1.0, 20001)
    time = np.r_[0.0, 5.0, 5.0 + grid]
    velocity = np.r_[-1e-3, -1e-3, np.full(20001, 1e-3)]
    friction = prescribed_friction("bliman_sorine", time, velocity, tolerance=1e-10).outputs[
        "friction"
    ]
    assert friction.max() == pytest.approx(2.502, abs=5e-4)


def test_with_the_slow_part_stronger_the_law_gives_out_work():
    """Outside the declared condition, f1 >= f2, the sliding force pushes."""
    work = prescribed_friction("bliman_sorine", *ways((1e-3, 1e-2)), {"f1": 17.0}).outputs["work"]
    assert work[-1] < 0
