"""A mass over an inclined spring: its equations anew, SciPy, and the threshold by theory."""

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.gallery.inclined_spring import findings as page
from ballscrew.gallery.inclined_spring import motions as ours
from ballscrew.gallery.inclined_spring.motions import AGEING, SLIP, Sliding, at

COUPLING = ballscrew.Coupling("monolithic")


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


@pytest.mark.parametrize("law", [AGEING, SLIP])
@pytest.mark.parametrize("values", [{}, {"psi": 0.5, "alpha": 0.3, "m": 3.0}, {"psi": -0.5}])
def test_a_motion_is_that_of_the_equations_written_anew(law, values):
    s = at(0.7, **values)
    run = ours.motion(law, s, 0.4, 0.01, u_start=1.0, x_start=1e-6)
    other = followed(law, s, (1e-6, 1.0, 0.0), 0.4, t_eval=run.time)
    np.testing.assert_allclose(np.log(run.outputs["v"]), np.log(other.y[1]), atol=1e-5)
    np.testing.assert_allclose(run.outputs["F"], other.y[0], rtol=1e-6)


@pytest.mark.parametrize("law", [AGEING, SLIP])
@pytest.mark.parametrize("values", [{}, {"psi": 0.4, "alpha": 0.5}, {"psi": -1.2, "W": -10.0}])
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


@settings(max_examples=25, deadline=None)
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


@pytest.mark.parametrize("law", [AGEING, SLIP])
def test_the_cycle_of_stick_slip_is_that_of_radau(law):
    s = Sliding(k=2000.0)
    cycle = ours.verdict(law, s, 10.0)
    other = followed(law, s, (0.0, 0.01, 0.0), 12.0, events=lambda _t, y: y[1] - s.v0)
    *_, first, _, last = other.t_events[0]
    assert cycle.period == pytest.approx(last - first, rel=1e-6)
    drop = 2 * s.k * cycle.amplitude["plant_x"]
    assert drop == pytest.approx(np.ptp(other.y_events[0][-2:, 0]), rel=1e-4)


def swings(s, start, turns):
    """Half ranges of ln(v/v0), turn after turn, by Radau."""
    begin = [s.start(start)[f"{n}_start"] for n in "xuw"]
    turn = 2 * np.pi / abs(s.roots()[0].imag)
    grid = np.linspace(0.0, turns * turn, 400 * turns + 1)
    u = np.log(followed(AGEING, s, begin, grid[-1], t_eval=grid).y[1] / s.v0)
    return np.array([np.ptp(u[400 * k : 400 * k + 440]) / 2 for k in range(1, turns - 1)])


def test_beyond_the_threshold_a_slow_pull_has_two_answers():
    s = at(1.003, v0=2e-4)
    edge, cycle = ours.balanced(s, 0.4, 1.0), ours.balanced(s, 1.2, 2.0)
    for start, grows in ((0.96 * edge, False), (1.04 * edge, True), (0.96 * cycle, True)):
        assert np.all((np.diff(swings(s, start, 10)) > 0.0) == grows), start
    assert np.all(np.diff(swings(s, 1.04 * cycle, 10)) < 0.0)
    assert ours.verdict(AGEING, s, 10.0, 0.01).kind.value == "isolated fixed point"
    seen = ours.verdict(AGEING, s, 10.0, 3.0)
    assert seen.kind.value == "limit cycle"
    assert seen.amplitude["plant_u"] == pytest.approx(cycle, rel=3e-3)  # it has not quite arrived


def first_lyapunov_coefficient(law, s):
    """Of the Hopf point, by the projection on the critical eigenvector, with exact derivatives.

    Per square of the amplitude of ln(v/v0), and with psi = 0 and time in L/v0.
    """
    d, u, w = x = sp.symbols("d u w")
    stiff, m = (s.b - s.a) * (1 + s.inertia), s.inertia * s.a
    ages = sp.exp(-w) - sp.exp(u) if law == AGEING else -sp.exp(u) * (u + w)
    field = [stiff * (1 - sp.exp(u)), sp.exp(-u) / m * (d - s.a * u - s.b * w), ages]
    origin = dict.fromkeys(x, 0)

    def derivatives(order):
        shape = (3,) * (order + 1)
        out = np.empty(shape)
        for index in np.ndindex(shape):
            out[index] = sp.diff(field[index[0]], *(x[i] for i in index[1:])).subs(origin)
        return out

    a, b, c = derivatives(1), derivatives(2), derivatives(3)
    values, right = np.linalg.eig(a)
    at_one = int(np.argmax(values.imag))
    omega, q = values[at_one].imag, right[:, at_one] / right[1, at_one]
    adjoint, left = np.linalg.eig(a.T)
    p = left[:, np.argmin(abs(adjoint + 1j * omega))]
    p = p / np.conj(np.vdot(p, q))
    bent = np.linalg.solve(a, np.einsum("ijk,j,k", b, q, q.conj()))
    twice = np.linalg.solve(2j * omega * np.eye(3) - a, np.einsum("ijk,j,k", b, q, q))
    sums = (
        np.einsum("ijkl,j,k,l", c, q, q, q.conj())
        - 2 * np.einsum("ijk,j,k", b, q, bent)
        + np.einsum("ijk,j,k", b, q.conj(), twice)
    )
    return np.vdot(p, sums).real / (2 * omega)


@pytest.mark.parametrize("ratio", [1.2, 1.5, 3.0])
@pytest.mark.parametrize("v0", [1e-4, 5e-4, 2e-3])
def test_the_first_lyapunov_coefficients_are_those_of_the_projection(ratio, v0):
    s = Sliding(b=0.01 * ratio, v0=v0)
    for law, closed in ((AGEING, s.bends), (SLIP, s.bends_slip)):
        assert closed * s.inertia == pytest.approx(first_lyapunov_coefficient(law, s), rel=1e-6)


def test_the_angle_that_is_best_is_that_of_friction_where_the_mass_is_light():
    psi = np.linspace(0.0, 1.2, 1201)
    best = psi[np.argmin([Sliding(psi=p, m=1e-6).critical for p in psi])]
    assert best == pytest.approx(math.atan(0.6), abs=1e-3)


def test_a_mass_that_its_weight_presses_on_jams_below_the_second_angle():
    """Its force doubles, and it does not move."""
    s = Sliding(psi=-1.2)
    u = -30.0  # slow enough for friction and the spring's pull to balance
    mu = s.mu0 + s.a * u
    force = s.W * mu / (math.cos(s.psi) + mu * math.sin(s.psi))
    stretch = (force - steady(s)[0]) / (s.k * math.cos(s.psi))
    run = ours.motion(AGEING, s, 40.0, 1.0, x_start=stretch, u_start=u)
    assert run.verdict.trusted, run.verdict.reason
    assert run.outputs["F"][0] == pytest.approx(force)
    assert run.outputs["F"][-1] > 1.99 * force
    assert run.outputs["v"].max() < 1e-12 * s.v0


def test_every_number_that_has_another_beside_it_agrees():
    assert all(f.agrees in (True, None) for f in page.findings())
