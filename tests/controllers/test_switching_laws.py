"""Sliding mode, super-twisting and relay: surface, layer and limit cycle in closed form."""

import linear_axis as la
import numpy as np
import pytest
from scipy.optimize import brentq

from ballscrew.controllers.relay import relay
from ballscrew.controllers.sliding_mode import sliding_mode
from ballscrew.controllers.super_twisting import super_twisting
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.component import TIME, symbol
from ballscrew.solver.kernel import Model

DEFAULT = {p.name: p.default for p in sliding_mode().parameters}
SLOPE, LAYER = DEFAULT["slope"], DEFAULT["layer"]
FALL = la.B / la.LAG * DEFAULT["level"]  # of |s| outside the layer, m/s^2
POLE = FALL / LAYER


def surface(run):
    return run.outputs["v"] + SLOPE * (run.outputs["x"] - 0.08)


def test_s_falls_in_a_straight_line_then_with_the_layer_s_pole():
    reached = (SLOPE * 0.08 - LAYER) / FALL
    assert reached == pytest.approx(0.0849, abs=1e-4)
    times = np.concatenate([np.linspace(0, reached, 30), reached + np.linspace(0, 1.5e-3, 31)[1:]])
    run = la.loop(la.rigid(), sliding_mode(), u_max=1e3).simulate(times)
    before = -SLOPE * 0.08 + FALL * times
    after = -LAYER * np.exp(-POLE * (times - reached))
    np.testing.assert_allclose(surface(run), np.where(times <= reached, before, after), atol=1e-8)


@pytest.mark.prove
def test_the_block_sticks_within_the_error_that_static_friction_holds():
    model = Model(loop_kernel("plant", "sliding_mode"))
    model.set_input("x_d", 0.08)
    left = abs(0.08 - model.simulate([0.0, 3.0, 4.0]).outputs["x"])
    assert left[2] == pytest.approx(left[1], rel=0.01)
    assert 0.5 * 1.284 / (la.M * SLOPE * POLE) < left[2] < 2.35 / (la.M * SLOPE * POLE)


def test_a_load_that_grows_slower_than_the_bound_is_held_off_the_surface():
    """|dd/dt| = 0.9 C: an exact sign keeps s at zero, the smoothed one within its layer."""
    values = {p.name: p.default for p in super_twisting().parameters}
    growth = 0.9 * values["k2"] * values["C"] / 1.1 * la.M  # N/s
    plant = la.rigid().substituted({symbol("load"): symbol("load") * TIME})
    model = la.loop(plant, super_twisting(), 0.08, 1e-9, u_max=1e3, plant_load=growth)
    settled = np.abs(surface(model.simulate(np.linspace(0.0, 0.6, 61))))[40:]
    # in the layer y follows a ramp of the load where k2 s/layer is its growth
    assert settled == pytest.approx(0.9 / 1.1 * values["layer"], rel=1e-3)


# -- the relay on an integrator with a lag -------------------------------------------------------


RELAY = {p.name: p.default for p in relay().parameters}
WIDTH = RELAY["width"]
SPEED = la.B * RELAY["level"]  # that it would come to


def exact_cycle():
    """Half the period [s] and the amplitude [m].

    From one change-over to the next the speed goes from -w to w = SPEED tanh(h/2 lag), and the
    block from -WIDTH to WIDTH: the error has to pass zero by WIDTH before the relay answers.
    """

    def travel(h):
        return SPEED * h - 2 * SPEED * la.LAG * np.tanh(h / (2 * la.LAG)) - 2 * WIDTH

    half = brentq(travel, 1e-6, 1.0, xtol=1e-15)
    w = SPEED * np.tanh(half / (2 * la.LAG))
    turn = la.LAG * np.log1p(w / SPEED)  # until the speed is zero
    beyond = w * la.LAG - SPEED * turn  # integral of SPEED - (SPEED + w) exp(-t/lag), reversed
    return half, WIDTH + beyond


def test_period_and_amplitude_are_the_exact_ones():
    half, amplitude = exact_cycle()
    model = la.loop(la.rigid(), relay(), 1e-3, 1e-10)
    model.simulate([0.0, 0.2])
    run = model.simulate(np.arange(0.2, 0.2 + 4 * half, half / 500))
    error = run.outputs["x"] - 1e-3
    assert error.max() == pytest.approx(amplitude, rel=1e-5)
    assert error.min() == pytest.approx(-amplitude, rel=1e-5)
    up = np.flatnonzero((error[:-1] < 0) & (error[1:] >= 0))
    crossings = run.time[up] - error[up] * np.diff(run.time)[up] / np.diff(error)[up]
    assert np.diff(crossings)[0] == pytest.approx(2 * half, rel=1e-5)


def test_nothing_is_commanded_until_the_error_is_beyond_the_hysteresis():
    for goal, wanted in ((0.9 * WIDTH, 0.0), (1.1 * WIDTH, 15.0), (-1.1 * WIDTH, -15.0)):
        model = la.loop(la.rigid(), relay(), goal)
        assert model.outputs(0.0, model.x)["u"] == wanted
