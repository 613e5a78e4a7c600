"""Figures of a run against closed forms."""

import math

import numpy as np
import pytest

from ballscrew.orchestration.study.figures import figures_of, hunting_verdict
from ballscrew.orchestration.study.loop import Course

STEP, COUNT, LIMIT = 1e-3, 2e-6, 36.0
TIME = np.arange(4001) * STEP


def course(position, reference=None, command=None, current=None, rate=None) -> Course:
    zero = np.zeros(len(TIME))
    reference = zero + 0.01 if reference is None else reference
    return Course(
        TIME,
        position,
        np.gradient(position, STEP),
        zero if current is None else current,
        zero if command is None else command,
        reference,
        zero if rate is None else rate,
    )


def test_errors_and_settling_of_an_exponential_are_its_closed_form():
    """e = 0.01 exp(-10 t): within 2 % after ln(50)/10 s, within 1 um after ln(1e4)/10 s."""
    found = figures_of(course(0.01 * (1 - np.exp(-10 * TIME))), COUNT, LIMIT)
    assert found.peak_error == pytest.approx(0.01)
    assert found.rms_error == pytest.approx(0.01 * math.sqrt(1 / 20 / 4), rel=1e-2)
    assert found.settling_2pct == pytest.approx(math.log(50) / 10, abs=STEP)
    assert found.settling_1um == pytest.approx(math.log(1e4) / 10, abs=STEP)
    assert found.settling_10counts == pytest.approx(math.log(0.01 / 20e-6) / 10, abs=STEP)
    assert found.overshoot == 0.0
    assert found.steady_error == pytest.approx(0.0, abs=1e-12)
    assert found.hunting_amplitude == 0.0
    assert not found.failed


def test_a_position_that_goes_to_and_fro_at_rest_hunts_with_its_amplitude_and_period():
    found = figures_of(course(0.01 + 3e-6 * np.cos(2 * np.pi * 5 * TIME)), COUNT, LIMIT)
    assert found.hunting_amplitude == pytest.approx(3e-6, rel=1e-3)
    assert found.hunting_period == pytest.approx(0.2, rel=1e-2)
    assert hunting_verdict(found.hunting) == "hunting"
    assert found.settling_1um == math.inf
    assert found.settling_10counts == 0.0


def test_a_slow_creep_is_no_hunting():
    found = figures_of(course(0.01 - 1e-5 * np.exp(-TIME)), COUNT, LIMIT)
    assert found.hunting_amplitude == 0.0
    assert math.isnan(found.hunting_period)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("position", "verdict"),
    [
        (0.01 + 1.01 * COUNT * np.sin(30 * TIME), "hunting"),
        (0.01 + 0.99 * COUNT * np.sin(30 * TIME), "undecided"),  # the encoder may be all there is
        (0.01 + 0.49 * COUNT * np.sin(30 * TIME), "none"),
        (0.01 + 9 * COUNT * np.sin(3 * TIME), "undecided"),  # less than two cycles in a second
        (0.01 - 9 * COUNT * (4 - TIME), "undecided"),  # it creeps
        (0.01 + 0 * TIME, "none"),
    ],
)
def test_hunting_is_told_from_rest_by_counts_and_cycles(position, verdict):
    assert hunting_verdict(figures_of(course(position), COUNT, LIMIT).hunting) == verdict


def test_a_motion_without_a_rest_says_nothing_of_hunting():
    moving = 0.01 * np.sin(TIME)
    assert math.isnan(figures_of(course(moving, moving), COUNT, LIMIT).hunting)


def test_effort_is_counted_as_it_is_spent():
    square = 36.0 * np.sign(np.sin(2 * np.pi * (TIME + STEP / 2)))  # four periods, and one sample
    found = figures_of(course(0 * TIME, command=square, current=0.1 * square / 36), COUNT, LIMIT)
    assert found.total_variation == pytest.approx(8 * 72)
    assert found.saturated_share == 1.0
    assert found.energy == pytest.approx(36 * 0.1 * 4)
    assert found.peak_current == pytest.approx(0.1)


def test_what_the_motor_gives_back_is_no_gain():
    found = figures_of(course(0 * TIME, command=1 + 0 * TIME, current=-1 + 0 * TIME), COUNT, LIMIT)
    assert found.energy == 0.0


def test_the_error_after_a_reversal_is_looked_for_where_the_set_point_turns():
    """A triangle of 1 s; 7 um for 20 ms after each turn, 50 um far away from the turns."""
    rate = np.where((TIME // 1).astype(int) % 2 == 0, 1e-3, -1e-3)
    reference = np.cumsum(rate) * STEP
    error = np.where((TIME % 1 < 0.02) & (TIME > 0.5), 7e-6, 0.0)
    error[(TIME % 1 > 0.4) & (TIME % 1 < 0.6)] = 50e-6
    found = figures_of(course(reference - error, reference, rate=rate), COUNT, LIMIT)
    assert found.reversal_error == pytest.approx(7e-6)
    assert found.peak_error == pytest.approx(50e-6)


def test_overshoot_counts_beyond_the_range_of_the_motion_and_back():
    reference = np.where(TIME < 2, -0.01, 0.0)
    position = np.where(TIME < 2, -0.011, 0.0005)
    assert figures_of(course(position, reference), COUNT, LIMIT).overshoot == pytest.approx(1e-3)


def test_a_run_that_stopped_has_failed_and_has_no_figures():
    empty = np.zeros(0)
    found = figures_of(Course(TIME, *(empty,) * 4, TIME, TIME, "no further"), COUNT, LIMIT)
    assert found.failed == 1.0
    assert math.isnan(found.rms_error)
