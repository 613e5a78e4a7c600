"""Set-points to follow: limits that hold, derivatives that are those of the signal."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from ballscrew.orchestration.reference_motions import (
    KINDS,
    move,
    move_times,
    read_motion,
    sine,
    triangle,
)
from ballscrew.orchestration.reference_signal import BadReference, Reference

sizes = st.floats(1e-6, 0.5)
limits = st.floats(1e-3, 10.0)


def integral(motion: Reference, order: int) -> np.ndarray:
    """Of a derivative, by the trapezoidal rule."""
    return cumulative_trapezoid(motion.derivative(order), motion.times, initial=0.0)


@settings(max_examples=40, deadline=None)
@given(distance=sizes, speed=limits, acceleration=limits, jerk=st.floats(1.0, 1e3))
def test_a_move_keeps_its_limits_and_arrives_at_rest(distance, speed, acceleration, jerk):
    motion = move(distance, speed, acceleration, jerk, back=0.0, dwell=0.01, start=0.0)
    tolerance = 1 + 1e-9
    assert np.abs(motion.derivative(1)).max() <= speed * tolerance
    assert np.abs(motion.derivative(2)).max() <= acceleration * tolerance
    jerks = np.abs(np.diff(motion.derivative(2)) / np.diff(motion.times))
    assert jerks.max() <= jerk * (1 + 1e-6)
    assert motion.values[-1] == pytest.approx(distance, rel=1e-9)
    assert np.all(np.diff(motion.values) >= -1e-12 * distance)
    assert abs(motion.derivative(1)[-1]) <= 1e-9 * speed


def decades(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most).map(lambda exponent: 10.0**exponent)


@settings(max_examples=150, deadline=None)
@given(decades(-6, 0), decades(-3, 1), decades(-3, 3), decades(0, 14), st.sampled_from([1, -1]))
@example(0.08, 0.1, 1.0, 1e12, 1)
def test_every_move_arrives_and_comes_back(size, speed, acceleration, jerk, sign):
    """However short its phases are beside its length."""
    assume(sum(move_times(size, speed, acceleration, jerk)) < 20)
    distance = sign * size
    motion = move(distance, speed, acceleration, jerk)
    dwells = np.flatnonzero((np.diff(motion.times) > 0.4) & (motion.derivative(1)[1:] == 0))
    assert motion.values[dwells[0]] == pytest.approx(distance, rel=1e-12)
    assert motion.values[dwells[1]] == pytest.approx(0.0, abs=1e-12 * size)
    ends = motion.times[dwells + 1]
    for order, limit in ((1, speed), (2, acceleration)):
        assert np.abs(motion.derivative(order)).max() <= limit * (1 + 1e-9)
        assert (motion.on(ends, order) == 0).all()


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


def test_a_long_move_is_as_long_as_the_closed_form():
    """0.5 m at 0.2 m/s, 1 m/s^2, 20 m/s^3: s/v + v/a + a/j."""
    ramp, flat, cruise = move_times(0.5, 0.2, 1.0, 20.0)
    assert 4 * ramp + 2 * flat + cruise == pytest.approx(0.5 / 0.2 + 0.2 / 1.0 + 1.0 / 20.0)


@pytest.mark.parametrize(
    "motion", [move(-0.03), sine(2e-3, 3.0, 1.0, start=0.2), triangle(1e-3, 0.5, 2.0, start=0.1)]
)
def test_derivatives_are_those_of_the_signal(motion):
    size = np.ptp(motion.values)
    assert np.abs(integral(motion, 1) - motion.values).max() <= 1e-5 * size
    if np.ptp(motion.derivative(2)):  # a triangle's turns are left out
        speed = np.ptp(motion.derivative(1))
        assert np.abs(integral(motion, 2) - motion.derivative(1)).max() <= 1e-5 * speed


def test_a_move_that_comes_back_ends_where_it_began():
    motion = move(0.08)
    assert motion.values.max() == pytest.approx(0.08, rel=1e-12)
    assert motion.values[-1] == pytest.approx(0.0, abs=1e-12)


def test_differences_of_a_file_are_exact_for_a_parabola():
    t = np.array([0.0, 0.1, 0.3, 0.4, 0.7])
    motion = Reference(t, 2 * t**2)
    np.testing.assert_allclose(motion.derivative(1), 4 * t, atol=1e-12)
    assert motion.all_at(0.2, (0, 1)) == pytest.approx([0.1, 0.8])


def test_a_step_is_where_it_was_asked_for():
    motion = read_motion("step:size=0.02,at=0.5")
    assert [motion.at(t) for t in (0.0, 0.5 - 1e-9, 0.5, 9.0)] == [0.0, 0.0, 0.02, 0.02]
    with pytest.raises(BadReference, match="give its velocity"):
        Reference(motion.times, motion.values).derivative(1)


def test_a_motion_on_a_grid_is_interpolated_and_held_outside():
    """A triangle of 1 mm in 0.2 s, from 0.1 s to 0.6 s; its velocity jumps between equal times."""
    motion = triangle(1e-3, 0.2, 0.5, start=0.1)
    grid = np.arange(700) * 1e-3 + 5e-4
    np.testing.assert_allclose(
        motion.on(grid, 0), np.interp(grid, motion.times, motion.values), atol=1e-17
    )
    turns = np.floor((grid - 0.1) / 0.1)
    forward = np.where(turns % 2 == 0, 0.01, -0.01)
    expected = np.where(grid < 0.1, 0.0, np.where(grid < 0.6, forward, 0.01))
    np.testing.assert_allclose(motion.on(grid, 1), expected, atol=1e-15)
    assert motion.on(np.array([0.2]), 1)[0] == pytest.approx(-0.01)  # of two values the later
    assert Reference.constant(0.3).on(grid, 0).tolist() == [0.3] * 700


def test_every_kind_can_be_written_and_a_file_name_is_none():
    for kind in KINDS:
        assert isinstance(read_motion(kind), Reference)
    assert read_motion("move.csv") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("move:lenght=1", "move has no 'lenght'; it has distance, speed"),
        ("move:speed=fast", "speed is 'fast', expected a number"),
        ("move:speed=inf", "expected a finite number"),
        ("move:speed=-1", "speed of a move is -1, expected more than 0"),
        ("move:back=2", "back of a move is 2, expected 0 or 1"),
        ("sine:frequency=0", "frequency of a sine is 0"),
        ("sine:frequency=1e9", "points, expected at most"),
        ("triangle:period=1e-9", "points, expected at most"),
    ],
)
def test_bad_motions_are_refused_in_one_line(text, message):
    with pytest.raises(BadReference, match=message) as caught:
        read_motion(text)
    assert "\n" not in str(caught.value)
