"""Set-points to follow: limits that hold, derivatives that are those of the signal."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from ballscrew.orchestration.loop.reference_motions import move, move_times, sine, triangle
from ballscrew.orchestration.master.reference_signal import Reference

sizes = st.floats(1e-6, 0.5)
limits = st.floats(1e-3, 10.0)


def integral(motion: Reference, order: int) -> np.ndarray:
    """Of a derivative up to each point, by Gauss' rule of six places: exact for the pieces."""
    places, weights = np.polynomial.legendre.leggauss(6)
    span = np.diff(motion.times)[:, None]
    inside = motion.times[:-1, None] + span * (1 + places) / 2
    parts = motion.on(inside.ravel(), order).reshape(inside.shape) @ weights * span[:, 0] / 2
    return np.append(0.0, np.cumsum(parts))


def decades(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most).map(lambda exponent: 10.0**exponent)


@pytest.mark.ci
@settings(max_examples=150, deadline=None)
@given(decades(-6, 0), decades(-3, 1), decades(-3, 3), decades(0, 14), st.sampled_from([1, -1]))
@example(0.08, 0.1, 1.0, 1e12, 1)
@example(10**-1.5, 10**-2.75, 1e3, 1e9, 1)
def test_every_move_arrives_and_comes_back(size, speed, acceleration, jerk, sign):
    """However short its phases are beside its length."""
    ramp, flat, cruise = move_times(size, speed, acceleration, jerk)
    lengths = 4 * ramp, 2 * flat, cruise, 0.5
    assume(sum(lengths) < 20)
    distance = sign * size
    motion = move(distance, speed, acceleration, jerk)
    arrived, back = motion.times[[-1]] - 0.5 - sum(lengths), motion.times[[-1]] - 0.5
    for end, place in ((arrived, distance), (back, 0.0)):
        assert motion.on(end - 1e-9, 0) == pytest.approx(place, abs=1e-8 * speed + 1e-12 * size)
        assert motion.on(end + 1e-9, 0) == place
        assert motion.on(end + 1e-9, 1) == motion.on(end + 1e-9, 2) == 0.0
    assert not len(motion.jumps((0,)))
    for order, limit in ((1, speed), (2, acceleration)):
        assert np.abs(motion.derivative(order)).max() <= limit * (1 + 1e-9)
        gone = integral(motion, order) - motion.derivative(order - 1)
        # Times are stored as doubles: each is off by up to half of its last digit.
        rounding = len(motion.times) * np.spacing(motion.times[-1]) * limit
        assert np.abs(gone).max() <= 1e-9 * np.abs(motion.derivative(order - 1)).max() + rounding


@pytest.mark.ci
@settings(max_examples=40, deadline=None)
@given(distance=sizes, speed=limits, acceleration=limits, jerk=st.floats(1.0, 1e3))
def test_no_move_within_the_limits_is_shorter(distance, speed, acceleration, jerk):
    """At least one limit is reached in each of its phases: the bang-bang optimum."""
    ramp, flat, cruise = move_times(distance, speed, acceleration, jerk)
    top = jerk * ramp
    assert top == pytest.approx(acceleration) or flat == pytest.approx(0.0, abs=1e-12)
    peak = top * (ramp + flat)
    assert peak == pytest.approx(speed) or cruise == pytest.approx(0.0, abs=1e-12)
    assert peak * (2 * ramp + flat + cruise) == pytest.approx(distance, rel=1e-9)


@pytest.mark.ci
@settings(max_examples=60, deadline=None)
@given(decades(-6, 0), decades(-1, 2.5), st.floats(0.0, 2.99))
def test_a_sine_is_one_to_round_off(amplitude, frequency, t):
    motion = sine(amplitude, frequency, 3.0)
    omega = 2 * np.pi * frequency
    exact = np.array([1 - np.cos(omega * t), np.sin(omega * t), np.cos(omega * t)])
    found = motion.all_at(t, (0, 1, 2))
    scale = amplitude / 2 * omega ** np.arange(3)
    np.testing.assert_allclose(found / scale, exact, atol=5e-11)


def test_differences_of_a_file_are_exact_for_a_parabola():
    t = np.array([0.0, 0.1, 0.3, 0.4, 0.7])
    motion = Reference(t, 2 * t**2)
    np.testing.assert_allclose(motion.derivative(1), 4 * t, atol=1e-12)
    assert motion.all_at(0.2, (0, 1)) == pytest.approx([0.1, 0.8])


def test_a_triangle_turns_where_it_should_and_rests_outside():
    """Of 1 mm in 0.2 s, from 0.1 s to 0.6 s; its velocity jumps at each turn."""
    motion = triangle(1e-3, 0.2, 0.5, start=0.1)
    grid = np.arange(700) * 1e-3 + 5e-4
    turns = np.arange(6) * 0.1 + 0.1
    corners = 1e-3 * (np.arange(6) % 2)
    np.testing.assert_allclose(motion.on(grid, 0), np.interp(grid, turns, corners), atol=1e-17)
    forward = np.where(np.floor((grid - 0.1) / 0.1) % 2 == 0, 0.01, -0.01)
    expected = np.where((grid < 0.1) | (grid > 0.6), 0.0, forward)
    np.testing.assert_allclose(motion.on(grid, 1), expected, atol=1e-15)
    at = motion.times[2:3]  # 0.2 s
    assert motion.on(at, 1)[0] == -motion.on(at, 1, before=True)[0] == pytest.approx(-0.01)
    assert not len(motion.jumps((0,)))
    assert motion.jumps((0, 1)) == pytest.approx(turns)
    assert Reference.constant(0.3).on(grid, 0).tolist() == [0.3] * 700
