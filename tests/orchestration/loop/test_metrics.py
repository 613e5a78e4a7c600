"""Figures of merit on courses whose figures are known by hand."""

import numpy as np
import pytest

from ballscrew.orchestration.loop.metrics import metrics, units_of_figures
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.loop_run import LoopRun
from ballscrew.orchestration.master.verdict import Verdict


def course(time, x, u, goal):
    return LoopRun(
        time=time,
        outputs={"x": x},
        commands={"u": u},
        reference=np.broadcast_to(goal, time.shape),
        coupling=Coupling.INTERFACE_JACOBIAN,
        coupling_reason="",
        corrected=False,
        residual_max={},
        effect_rate_max={},
        macro_steps=len(time) - 1,
        step_range=(1.0, 1.0),
        verdict=Verdict(True, "", ""),
    )


def test_exponential_approach():
    t = np.linspace(0, 10, 10_001)
    m = metrics(course(t, 0.08 * (1 - np.exp(-t)), -5 * np.sin(t) * (t < 4), 0.08))
    assert m.settling_time_2pct == pytest.approx(np.log(50), abs=1e-6)
    assert m.overshoot == 0.0
    assert m.steady_state_error == pytest.approx(0.08 * np.exp(-10), rel=1e-9)
    assert m.iae == pytest.approx(0.08 * (1 - np.exp(-10)), rel=1e-6)
    assert m.peak_voltage == pytest.approx(5, abs=1e-5)
    assert m.peak_voltage_time == pytest.approx(np.pi / 2, abs=1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_overshoot_has_the_direction_of_the_step(sign):
    t = np.linspace(0, 20, 20_001)
    m = metrics(course(t, sign * (1 - np.exp(-t) * np.cos(3 * t)), t, sign * 1.0))
    turn = (np.pi + np.arctan(-1 / 3)) / 3
    assert m.overshoot == pytest.approx(-np.exp(-turn) * np.cos(3 * turn), abs=1e-6)


def test_the_errors_along_a_motion_are_those_of_a_sine_in_closed_form():
    t = np.linspace(0, 10, 100_001)
    m = metrics(course(t, 0.0 * t, 0.0 * t, 0.03 * np.sin(2 * np.pi * t)))
    assert m.rms_error == pytest.approx(0.03 / np.sqrt(2), rel=1e-8)
    assert m.largest_error == pytest.approx(0.03, rel=1e-6)


def test_what_a_run_does_not_define_is_none():
    t = np.linspace(0, 1, 11)
    never = metrics(course(t, 0 * t, t, 1.0))
    assert never.settling_time_2pct is None
    assert (never.rms_error, never.largest_error) == (None, None)
    moving = metrics(course(t, t, t, t))
    assert moving.settling_time_2pct is None
    assert moving.overshoot is None
    assert moving.iae == 0.0


def test_the_residual_has_the_unit_of_its_command():
    run = course(*np.ones((3, 2)), 1.0)
    run.residual_max["P"], run.units["P"] = 1.0, "W"
    assert units_of_figures(run)["coupling_residual_max"] == "W"
