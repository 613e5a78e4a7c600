"""Friction under a prescribed motion: what is asked is what is moved."""

import numpy as np
import pytest
from motions import pieces
from prescribed_motion import prescribed_friction


def test_position_and_velocity_are_those_asked_for_jumps_included():
    time = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    velocity = np.array([0.0, 2e-3, -1e-3, -1e-3, 3e-3])
    got = prescribed_friction("lugre", time, velocity).outputs
    np.testing.assert_allclose(got["velocity"], velocity, atol=1e-18)
    np.testing.assert_allclose(got["x"], [0, 1e-3, 1e-3, 0, 1e-3], atol=1e-12)


def test_work_is_friction_times_way():
    got = prescribed_friction("dahl", *pieces((1e-3, 10.0))).outputs
    assert got["work"][-1] == pytest.approx(2.0 * 1e-2 - 2.0**2 / 87750, rel=1e-6)


def test_a_motion_may_start_at_any_time_and_deflection():
    values = {"z_start": 1e-5}
    one = prescribed_friction("lugre", [0.0, 0.5], [1e-3, 2e-3], values).outputs["friction"]
    other = prescribed_friction("lugre", [7.0, 7.5], [1e-3, 2e-3], values).outputs["friction"]
    np.testing.assert_allclose(one, other, rtol=1e-9)
    assert one[0] > 66967 * 1e-5


def test_a_parameter_that_the_law_does_not_have_is_refused():
    with pytest.raises(KeyError, match="no parameter 'sigma0'"):
        prescribed_friction("dahl", [0.0, 1.0], [0.0, 0.0], {"sigma0": 1.0})
