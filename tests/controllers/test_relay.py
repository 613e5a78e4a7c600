"""The relay's limit cycle against its exact solution on an integrator with a lag."""

import linear_axis as la
import numpy as np
import pytest
from scipy.optimize import brentq

from ballscrew.controllers.relay import relay

DEFAULT = {p.name: p.default for p in relay().parameters}
WIDTH = DEFAULT["width"]
SPEED = la.B * DEFAULT["level"]  # that it would come to


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
