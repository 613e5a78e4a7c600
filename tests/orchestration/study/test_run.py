"""A run against the reference, its figures against closed forms, and its check over FMUs."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.reference_motions import as_reference
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study import run as run_module
from ballscrew.orchestration.study.run import (
    Course,
    StudyLoop,
    check_over_fmus,
    figures_of,
    hunting_verdict,
)

STEP, COUNT, LIMIT = 1e-3, 2e-6, 36.0
TIME = np.arange(4001) * STEP
AT_REST = 0.01 + 0 * TIME


def figures(position, reference=AT_REST, command=0 * TIME, current=0 * TIME, rate=0 * TIME):
    course = Course(TIME, reference, rate, position, 0 * TIME, current, command)
    return figures_of(course, COUNT, LIMIT)


def test_errors_and_settling_of_an_exponential_are_its_closed_form():
    """e = 0.01 exp(-10 t): within 2 % after ln(50)/10 s, within 1 um after ln(1e4)/10 s."""
    found = figures(0.01 * (1 - np.exp(-10 * TIME)))
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
    found = figures(0.01 + 3e-6 * np.cos(2 * np.pi * 5 * TIME))
    assert found.hunting_amplitude == pytest.approx(3e-6, rel=1e-3)
    assert found.hunting_period == pytest.approx(0.2, rel=1e-2)
    assert found.settling_1um == math.inf
    assert found.settling_10counts == 0.0


@pytest.mark.parametrize(
    ("position", "verdict"),
    [
        (0.01 + 1.01 * COUNT * np.sin(30 * TIME), "hunting"),
        (0.01 + 0.99 * COUNT * np.sin(30 * TIME), "undecided"),  # the encoder may be all there is
        (0.01 + 0.49 * COUNT * np.sin(30 * TIME), "none"),
        (0.01 + 9 * COUNT * np.sin(3 * TIME), "undecided"),  # less than two cycles in a second
        (0.01 - 9 * COUNT * (4 - TIME), "undecided"),  # it creeps
    ],
)
def test_hunting_is_told_from_rest_by_counts_and_cycles(position, verdict):
    assert hunting_verdict(figures(position).hunting) == verdict
    assert math.isnan(figures(position, position + TIME).hunting)  # a motion without a rest


def test_effort_is_counted_as_it_is_spent_and_what_the_motor_gives_back_is_no_gain():
    square = 36.0 * np.sign(np.sin(2 * np.pi * (TIME + STEP / 2)))  # four periods, and one sample
    found = figures(0 * TIME, command=square, current=0.1 * square / 36)
    assert found.total_variation == pytest.approx(8 * 72)
    assert found.saturated_share == 1.0
    assert found.energy == pytest.approx(36 * 0.1 * 4)
    assert (found.peak_current, found.peak_command) == pytest.approx((0.1, 36.0))
    assert figures(0 * TIME, command=1 + 0 * TIME, current=-1 + 0 * TIME).energy == 0.0


def test_the_error_after_a_reversal_is_looked_for_where_the_set_point_turns():
    """A triangle of 1 s; 7 um for 20 ms after each turn, 50 um far away from the turns."""
    rate = np.where((TIME // 1).astype(int) % 2 == 0, 1e-3, -1e-3)
    reference = np.cumsum(rate) * STEP
    error = np.where((TIME % 1 < 0.02) & (TIME > 0.5), 7e-6, 0.0)
    error[(TIME % 1 > 0.4) & (TIME % 1 < 0.6)] = 50e-6
    found = figures(reference - error, reference, rate=rate)
    assert found.reversal_error == pytest.approx(7e-6)
    assert found.peak_error == pytest.approx(50e-6)


def test_overshoot_counts_beyond_the_range_of_the_motion_and_back():
    reference = np.where(TIME < 2, -0.01, 0.0)
    position = np.where(TIME < 2, -0.011, 0.0005)
    assert figures(position, reference).overshoot == pytest.approx(1e-3)


MOTION = as_reference("move:distance=0.005,speed=0.1,start=0,dwell=0.1,back=0"), 0.2


def checked(controller, values, **wrong):
    """The check of a run, whose table has these errors by a factor."""
    loop = StudyLoop(loop_kernel("plant", controller))
    own = {f"controller_{name}": value for name, value in values.items()}
    table = figures_of(loop.run(own, MOTION), COUNT, LIMIT)._asdict()
    table |= {name: table[name] * factor for name, factor in wrong.items()}
    over = Loop(fmu(controller), fmu("plant"), controller_values=values, isolate=False)
    return check_over_fmus(loop, over, MOTION, 1e-6, table)


@pytest.mark.ci
@pytest.mark.parametrize(
    "wrong",
    [{"rms_error": 1.001}, {"peak_error": 0.999}, {"rms_error": np.nan, "peak_error": np.nan}],
)
def test_a_table_that_says_other_figures_than_the_run_over_fmus_disagrees(wrong):
    assert not checked("pid_sampled", {}, **wrong).agrees


@pytest.mark.ci
@pytest.mark.parametrize(
    ("controller", "values", "most"),
    [
        ("pid_sampled", {}, 1e-11),  # m
        ("nctf+sampled", {"sample_time": 5e-5}, 1e-7),
        ("nctf", {}, 1e-6),
    ],
)
def test_a_loop_that_converges_is_trusted_and_agrees(controller, values, most):
    found = checked(controller, values)
    assert found.coupling == "trusted"
    assert found.agrees
    assert found.allowed < most


@pytest.mark.ci
@pytest.mark.parametrize(
    ("apart", "flips", "agrees"),
    [
        (1e-9, lambda tolerance: 3e-8 < tolerance < 5e-8, True),  # as a few tolerances do, too
        (1e-9, lambda tolerance: False, False),
        (2e-8, lambda tolerance: 3e-8 < tolerance < 5e-8, False),  # more than ten times as much
    ],
)
def test_a_count_that_few_tolerances_see_is_no_difference(monkeypatch, apart, flips, agrees):
    """A position that is a count further where the solver's tolerance says so, as behind encoders.

    Such runs were called different: one of eighty of those of `docs/swap-study.md`.
    """
    time, none = np.linspace(0.0, 0.2, 5), np.zeros(5)

    def run(values, motion, tolerance):
        return Course(time, none, none, none + 1e-9 * flips(tolerance), none, none, none)

    def over_fmus(loop):
        verdict = SimpleNamespace(word="trusted", reason="", error_estimate={"x": 0.0})
        found = SimpleNamespace(time=time, outputs={"x": none + apart}, verdict=verdict)
        return SimpleNamespace(run=found)

    monkeypatch.setattr(run_module, "run_closed_loop", over_fmus)
    table = {"rms_error": 0.0, "peak_error": 0.0, "failed": 0.0}
    loop = SimpleNamespace(run=run)
    assert check_over_fmus(loop, Loop("pid"), MOTION, 1e-6, table).agrees is agrees
