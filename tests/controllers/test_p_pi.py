"""P-PI: its linear loop in closed form, and exact tracking by feed-forward."""

import linear_axis as la
import numpy as np

from ballscrew.controllers.p_pi import VELOCITY_TIME, cascade, p_pi

TIMES = np.linspace(0.0, 2.0, 201)


def test_gains_place_the_poles_that_the_rule_says():
    """The PI cancels the lag, so the speed follows like 1/(T s + 1), and T s^2 + s + Kx = 0."""
    time = VELOCITY_TIME + la.L / la.R
    gains = cascade()
    np.testing.assert_allclose(gains.proportional, la.LAG / (la.B * time), rtol=1e-12)
    np.testing.assert_allclose(gains.integral, 1 / (la.B * time), rtol=1e-12)
    np.testing.assert_allclose(gains.position, 1 / (4 * VELOCITY_TIME), rtol=1e-12)


def test_on_the_rigid_axis_the_step_is_that_of_two_poles():
    time = VELOCITY_TIME + la.L / la.R
    p, q = np.roots([time, 1.0, cascade().position]).astype(complex)
    exact = 0.08 * (1 - (q * np.exp(p * TIMES) - p * np.exp(q * TIMES)) / (q - p)).real
    run = la.loop(la.rigid(), p_pi()).simulate(TIMES)
    np.testing.assert_allclose(run.outputs["x"], exact, atol=1e-10)
