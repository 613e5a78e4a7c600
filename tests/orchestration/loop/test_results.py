"""What a run's result shows: figures known by hand, numbers with units."""

import numpy as np
import pytest

from ballscrew.loop_results import units_of_figures
from ballscrew.orchestration.loop.closed_loop import metrics
from ballscrew.orchestration.loop.shown import length, quantity, shown_unit
from ballscrew.orchestration.master.march import LoopRun
from ballscrew.orchestration.master.verdict import Verdict
from ballscrew.result import in_turning_units


def course(time, x, u, goal):
    return LoopRun(
        time=time,
        outputs={"x": x},
        commands={"u": u},
        reference=np.broadcast_to(goal, time.shape),
        residual_max={},
        effect_rate_max={},
        macro_steps=len(time) - 1,
        step_range=(1.0, 1.0),
        verdict=Verdict(True, "", ""),
    )


def test_exponential_approach():
    t = np.linspace(0, 10, 10_001)
    m = metrics(course(t, 0.08 * (1 - np.exp(-t)), -5 * np.sin(t) * (t < 4), 0.08))
    assert m["settling_time_2pct"] == pytest.approx(np.log(50), abs=1e-6)
    assert m["overshoot"] == 0.0
    assert m["steady_state_error"] == pytest.approx(0.08 * np.exp(-10), rel=1e-9)
    assert m["iae"] == pytest.approx(0.08 * (1 - np.exp(-10)), rel=1e-6)
    assert m["peak_voltage"] == pytest.approx(5, abs=1e-5)
    assert m["peak_voltage_time"] == pytest.approx(np.pi / 2, abs=1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_overshoot_has_the_direction_of_the_step(sign):
    t = np.linspace(0, 20, 20_001)
    m = metrics(course(t, sign * (1 - np.exp(-t) * np.cos(3 * t)), t, sign * 1.0))
    turn = (np.pi + np.arctan(-1 / 3)) / 3
    assert m["overshoot"] == pytest.approx(-np.exp(-turn) * np.cos(3 * turn), abs=1e-6)


def test_the_errors_along_a_motion_are_those_of_a_sine_in_closed_form():
    t = np.linspace(0, 10, 100_001)
    m = metrics(course(t, 0.0 * t, 0.0 * t, 0.03 * np.sin(2 * np.pi * t)))
    assert m["rms_error"] == pytest.approx(0.03 / np.sqrt(2), rel=1e-8)
    assert m["largest_error"] == pytest.approx(0.03, rel=1e-6)


def test_what_a_run_does_not_define_is_none():
    t = np.linspace(0, 1, 11)
    never, moving = metrics(course(t, 0 * t, t, 1.0)), metrics(course(t, t, t, t))
    assert (never["settling_time_2pct"], never["rms_error"], never["largest_error"]) == (None,) * 3
    assert (moving["settling_time_2pct"], moving["overshoot"], moving["iae"]) == (None, None, 0.0)


def test_the_residual_has_the_unit_of_its_command():
    run = course(*np.ones((3, 2)), 1.0)
    run.residual_max["P"], run.units["P"] = 1.0, "W"
    assert units_of_figures(run)["coupling_residual_max"] == "W"


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
    assert shown_unit([1e-6, -0.02, np.inf, np.nan], "m") == (1e3, "mm")


@pytest.mark.parametrize(
    ("slides", "turns"),
    [
        ("0.02 N rms of 4.6 N rms; 1.2 mm rms", "0.02 N*m rms of 4.6 N*m rms; 1.2 mrad"),
        ("sigma2   1.49955  1.4877 .. 1.5115     N*s/m", "N*m*s/rad"),
        ("m        0.499   0.49 .. 0.5     kg", "J        0.499   0.49 .. 0.5     kg*m^2"),
        ("0.3 m/s^2, 12 um.", "0.3 rad/s^2, 12 urad."),
        ("0.00709 ms (-0.55 .. 0.57), 1 kHz, 5 Nm.csv",) * 2,
    ],
)
def test_units_are_those_of_a_body_that_turns(slides, turns):
    assert turns in in_turning_units(slides)
