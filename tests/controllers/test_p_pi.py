"""P-PI: its linear loop in closed form, and exact tracking by feed-forward."""

import linear_axis as la
import numpy as np
import sympy as sp
from scipy.signal import StateSpace, lsim

from ballscrew.controllers.p_pi import VELOCITY_TIME, cascade, p_pi
from ballscrew.solver.component import TIME

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


def test_with_inductance_the_step_is_that_of_scipy_s_linear_system():
    g = cascade()
    a, b = la.matrices()
    error = np.array([[-g.position, -1.0, 0.0]])
    whole = np.block([[a + b @ error * g.proportional, b], [g.integral * error, np.zeros((1, 1))]])
    drive = np.vstack([b * g.proportional * g.position, [[g.integral * g.position]]])
    system = StateSpace(whole, drive, [[1.0, 0.0, 0.0, 0.0]], [[0.0]])
    _, exact, _ = lsim(system, np.full(len(TIMES), 0.08), TIMES)
    run = la.loop(la.sliding(), p_pi()).simulate(TIMES)
    np.testing.assert_allclose(run.outputs["x"], exact, atol=1e-9)


def test_feed_forward_leaves_no_error_on_the_rigid_axis_and_that_of_the_jerk_on_the_other():
    course = sp.Rational(1, 100) * (1 - sp.cos(4 * TIME))
    wanted = 0.01 * (1 - np.cos(4 * TIMES))
    law = la.following(p_pi(), course)
    exact = la.loop(la.rigid(), law, Fa=la.LAG / la.B).simulate(TIMES)
    np.testing.assert_allclose(exact.outputs["x"], wanted, atol=1e-11)
    without = la.loop(la.sliding(), la.following(p_pi(), course), Fv=0.0, Fa=0.0).simulate(TIMES)
    forward = la.loop(la.sliding(), law).simulate(TIMES)
    off = [np.abs(run.outputs["x"] - wanted).max() for run in (without, forward)]
    # left of the voltage is L m/motor times the jerk, against 1/b times the speed
    left = la.L * la.M / la.MOTOR * 4**2 * la.B
    assert off[1] < 3 * left * off[0]
