"""A mass over an inclined spring: its equations anew, SciPy, and the threshold by theory."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballscrew.gallery.inclined_spring import motions as ours
from ballscrew.gallery.inclined_spring.motions import AGEING, SLIP, Sliding, at


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


def eigenvalues(law, s):
    y, of = steady(s), rates(law, s)
    columns = [
        (np.array(of(0.0, y + e)) - np.array(of(0.0, y - e))) / (2 * e.sum())
        for e in np.diag(1e-5 * y)
    ]
    found = np.linalg.eigvals(np.array(columns).T)
    return found[np.lexsort((-found.imag, -found.real))]


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


@pytest.mark.parametrize(
    ("law", "values"), [(AGEING, {"psi": 0.4, "alpha": 0.5}), (SLIP, {"psi": -1.2, "W": -10.0})]
)
def test_the_cubic_has_the_eigenvalues_of_numerical_derivatives(law, values):
    s = Sliding(**values)
    np.testing.assert_allclose(s.roots(), eigenvalues(law, s), rtol=1e-5)


drawn = st.fixed_dictionaries(
    {
        "psi": st.floats(-0.7, 1.2),
        "alpha": st.floats(0.0, 0.5),
        "b": st.floats(0.012, 0.03),
        "m": st.floats(0.02, 10.0),
        "mu0": st.floats(0.2, 0.9),
    }
)


@pytest.mark.ci
@settings(max_examples=12, deadline=None)
@given(st.sampled_from([AGEING, SLIP]), drawn, st.floats(0.8, 1.25))
@example(AGEING, {}, 0.98)
@example(SLIP, {"psi": -0.5, "alpha": 0.3}, 1.02)
def test_swings_fade_above_the_threshold_and_grow_below_it(law, values, share):
    """Of all three states, started off the eigenvector."""
    level = Sliding(**values)
    gain = level.grip - level.alpha * (1 + level.inertia) * math.sin(level.psi)
    assume(abs(share - 1.0) > 0.01)
    assume(level.grip > 0.1 and gain > 0.1)
    s = at(share, **values)
    turn = 2 * np.pi / max(abs(s.roots()[0].imag), 0.1 * s.v0 / s.L)
    run = ours.motion(law, s, 16 * turn, turn / 20, u_start=1e-3)
    u = np.abs(np.log(run.outputs["v"] / s.v0))
    early, late = u[20:100].max(), u[-80:].max()
    assert (late < early) if share > 1.0 else (late > early)
