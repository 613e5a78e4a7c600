"""A mass over an inclined spring: its equations anew, and by SciPy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.gallery.inclined_spring import findings as ours
from ballscrew.gallery.inclined_spring.findings import AGEING, SLIP, at


def rates(law, s):
    """Rates of force, velocity and age, in SI units and without logarithms as states."""
    sin, cos = math.sin(s.psi), math.cos(s.psi)

    def of(_t, y):
        f, v, theta = y
        pulled = s.k * cos * (s.v0 - v)
        normal = s.W - f * sin
        mu = s.mu0 + s.a * np.log(v / s.v0) + s.b * np.log(s.v0 * theta / s.L)
        slid = v * theta / s.L
        ages = 1.0 - slid if law == AGEING else -slid * np.log(slid)
        ages -= s.alpha * theta / s.b * (-pulled * sin) / normal
        return [pulled, (f * cos - normal * mu) / s.m, ages]

    return of


def steady(s):
    force = s.mu0 * s.W / (math.cos(s.psi) + s.mu0 * math.sin(s.psi))
    return np.array([force, s.v0, s.L / s.v0])


def followed(law, s, start, stop, **more):
    """By Radau, from (stretch, u, w) as the component has them."""
    d, u, w = start
    begin = steady(s) * [1.0, math.exp(u), math.exp(w)] + [s.k * math.cos(s.psi) * d, 0.0, 0.0]
    scales = 1e-10 * np.array([1.0, 1e-3 * s.v0, s.L / s.v0])
    return solve_ivp(rates(law, s), (0.0, stop), begin, "Radau", rtol=1e-9, atol=scales, **more)


@pytest.mark.parametrize(
    ("law", "values"), [(AGEING, {"psi": 0.5, "alpha": 0.3, "m": 3.0}), (SLIP, {"psi": -0.5})]
)
def test_a_motion_is_that_of_the_equations_written_anew(law, values):
    s = at(0.7, **values)
    run = ours.motion(law, s, 0.4, 0.01, u_start=1.0, x_start=1e-6)
    other = followed(law, s, (1e-6, 1.0, 0.0), 0.4, t_eval=run.time)
    np.testing.assert_allclose(np.log(run.outputs["v"]), np.log(other.y[1]), atol=1e-5)
    np.testing.assert_allclose(run.outputs["F"], other.y[0], rtol=1e-6)
