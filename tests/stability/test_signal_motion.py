"""What signals alone tell of a motion: rest, a cycle, or nothing."""

from dataclasses import dataclass

import numpy as np
import pytest

from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov_over_fmus import signal_motion


@dataclass
class Course:
    """A run with one output."""

    time: np.ndarray
    outputs: dict
    stopped: str = ""
    diverged: bool = False


T = np.linspace(0.0, 20.0, 20001)


def test_signals_tell_rest_and_cycles_and_nothing_else():
    for signal, kind in (
        (np.exp(-2.0 * T), Kind.REST),
        (0.08 + 0.0 * T, Kind.REST),
        (np.exp(-0.2 * T), Kind.UNDECIDED),  # still falling, and nothing says where to
        (np.sqrt(1.0 + T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.3 * np.cos(14.0 * T), Kind.CYCLE),
        (np.sin(7.0 * T) + 0.8 * np.sin(3.5 * T + 0.3), Kind.CYCLE),  # two returns
        (np.exp(-0.1 * T) * np.sin(7.0 * T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.5 * np.sin(7.0 * np.sqrt(2.0) * T), Kind.UNDECIDED),
    ):
        assert signal_motion(Course(T, {"x": signal}), {"x": 1.0}).kind is kind


def test_at_rest_the_first_tangent_tells_a_line_from_a_point():
    run = Course(T, {"x": np.exp(-2.0 * T)})
    for rate, kind in (
        (0.0, Kind.LINE),
        (-1.0, Kind.FIXED_POINT),
        (-0.02, Kind.REST),
        (0.5, Kind.UNDECIDED),
    ):
        assert signal_motion(run, {"x": 1.0}, rate * T).kind is kind


def test_a_run_that_ended_early_diverges_or_is_undecided():
    assert signal_motion(Course(T, {"x": T}, "x left", True), {"x": 1.0}).kind is Kind.DIVERGES
    assert signal_motion(Course(T, {"x": T}, "died"), {"x": 1.0}).kind is Kind.UNDECIDED


def steps(end, period):
    """It stands still but for a tenth of each period: it moves on, and back in the next."""
    time = np.linspace(0.0, end, 4001)
    ramp = np.clip((time % period) / (0.1 * period), 0.0, 1.0)
    odd = np.floor(time / period) % 2
    return Course(time, {"x": np.where(odd, 1.0 - ramp, ramp)})


@pytest.mark.parametrize("periods", [2.9, 1.95])
def test_signals_that_stood_as_long_before_and_moved_again_are_not_at_rest(periods):
    motion = signal_motion(steps(periods, 1.0), {"x": 1.0})
    assert motion.kind is Kind.UNDECIDED, motion.evidence
