"""Finite-time exponents against exact ones, exact maps, and solvers that are not ours."""

import itertools

import known_systems as ks
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Mode, State, symbol
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import (
    FARTHEST,
    _followed,
    _may_be_explicit,
    _TooStiff,
    follow_returns,
    follow_tangents,
)

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once


def linear_exponents(matrix, stop, tolerance=1e-9, **settings_of_follow):
    model = Model(ks.linear(), ks.entries(matrix), tolerance)
    return follow_tangents(model, [0.0, stop], **settings_of_follow)


@st.composite
def stiff_matrices(draw):
    """V diag(-rates) V^-1 with rates up to 1e5 times apart and directions well apart."""
    decades = draw(st.lists(st.floats(-0.5, 4.5), min_size=3, max_size=3))
    seed = draw(st.integers(0, 2**32 - 1))
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    skew = np.eye(3) + np.triu(np.random.default_rng(seed + 1).uniform(-1, 1, (3, 3)), 1)
    directions = turn @ skew
    return directions @ np.diag(-(10.0 ** np.array(decades))) @ np.linalg.inv(directions)


@settings(deadline=None, max_examples=25, derandomize=True)
@given(stiff_matrices())
def test_exponents_of_random_stiff_linear_systems_are_the_exact_ones(matrix):
    stop = 0.5
    fastest = np.abs(np.linalg.eigvals(matrix)).max()
    exact = ks.stretched(matrix, stop, parts=int(fastest * stop / 5.0) + 1)
    run = linear_exponents(matrix, stop)
    np.testing.assert_allclose(run.exponents, exact, rtol=1e-8, atol=1e-12 * fastest + 1e-9)
    assert run.growth[-1].sum() == pytest.approx(np.trace(matrix) * stop, rel=1e-9)


ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
MATRIX = np.array([[-1.0, 4.0, 0.0], [-4.0, -2.0, 1.0], [3.0, 0.0, -9.0]])


def test_finite_time_exponents_are_those_of_the_first_frame_asked_for():
    turned = linear_exponents(MATRIX, 1.0, frame=ROTATION).exponents
    np.testing.assert_allclose(turned, ks.stretched(MATRIX, 1.0, ROTATION), atol=1e-10)
    assert np.max(np.abs(turned - linear_exponents(MATRIX, 1.0).exponents)) > 0.1


def variational(model, stop, interval):
    """Exponents by scipy's Radau on motion and all tangents at once, a QR after every interval.

    The equations and their Jacobian are ours, everything done with them is not.
    """
    n = len(model.x)

    def rhs(t, w):
        q = w[n:].reshape(n, n)
        return np.concatenate([model.derivatives(t, w[:n]), (model.jacobian(t, w[:n]) @ q).ravel()])

    def jac(t, w):
        a = model.jacobian(t, w[:n])
        block = np.zeros((n + n * n, n + n * n))
        block[:n, :n] = a
        block[n:, n:] = np.kron(a, np.eye(n))  # without second derivatives: Newton's matrix only
        return block

    x, q, logs = model.x.copy(), np.eye(n), np.zeros(n)
    edges = np.linspace(0.0, stop, round(stop / interval) + 1)
    atol = np.concatenate(
        [1e-11 * np.array([s.nominal for s in model.kernel.states]), np.full(n * n, 1e-12)]
    )
    for a, b in itertools.pairwise(edges):
        start = np.concatenate([x, q.ravel()])
        run = solve_ivp(rhs, (a, b), start, method="Radau", jac=jac, rtol=1e-8, atol=atol)
        assert run.success
        x = run.y[:n, -1]
        q, r = np.linalg.qr(run.y[n:, -1].reshape(n, n))
        logs += np.log(np.abs(np.diag(r)))
    return logs / stop


def nominal_loop(controller, tolerance):
    model = Model(loop_kernel("plant", controller), {}, tolerance)
    model.set_input("x_d", 0.08)
    return model


@pytest.mark.parametrize(
    ("controller", "stop", "interval"),
    [("iol", 0.04, 4e-3), pytest.param("nctf", 0.05, 1e-3, marks=pytest.mark.prove)],
)
def test_all_exponents_of_the_nominal_loops_agree_with_radau_on_the_variational_system(
    controller, stop, interval
):
    ours = follow_tangents(nominal_loop(controller, 1e-12), [0.0, stop]).exponents
    theirs = variational(nominal_loop(controller, 1e-11), stop, interval)
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)


def one_bounce(shake, e=ks.RESTITUTION, g=ks.GRAVITY):
    """Linearized exact map of the ball's period-one bounce, in time and speed after impact.

    Also the state at t = 0. The table moves as (shake g / w^2) sin(w t); impacts meet it at the
    phase p with shake cos p = pi (1 - e)/(1 + e), sin p > 0.
    """
    w = ks.TABLE_FREQUENCY
    period = 2.0 * np.pi / w
    cosine = np.pi * (1.0 - e) / (1.0 + e) / shake
    sine = np.sqrt(1.0 - cosine**2)
    pull = shake * g * sine
    matrix = [[1.0, (1.0 + e) / g], [-(1.0 + e) * pull, e**2 - (1.0 + e) ** 2 * pull / g]]
    since = period - np.arccos(cosine) / w
    speed = 0.5 * g * period
    start = [shake * g / w**2 * sine + speed * since - 0.5 * g * since**2, speed - g * since]
    return np.array(matrix), start, period


# Period doubling of the period-one bounce: its multiplier is -1 at
# (pi (1-e)/(1+e))^2 + (2 (1+e^2)/(1+e)^2)^2 = shake^2. The conditions of stability are in
# J. J. Barroso, M. V. Carneiro, E. E. N. Macau, Phys. Rev. E 79, 026206 (2009).
DOUBLING = float(
    np.hypot(
        np.pi * (1 - ks.RESTITUTION) / (1 + ks.RESTITUTION),
        2 * (1 + ks.RESTITUTION**2) / (1 + ks.RESTITUTION) ** 2,
    )
)


@pytest.mark.parametrize("shake", [1.5, DOUBLING])
def test_a_bouncing_ball_has_the_multipliers_of_its_exact_map(shake):
    matrix, start, period = one_bounce(shake)
    exact = np.sort(np.log(np.abs(np.linalg.eigvals(matrix))) / period)[::-1]
    model = Model(
        ks.bouncing_ball(), {"shake": shake, "x_start": start[0], "v_start": start[1]}, 1e-11
    )
    settle = follow_tangents(model, [0.0, 30.0 * period])
    run = follow_tangents(model, period * np.array([30.0, 40.0]), frame=settle.frame)
    assert run.events == 40
    np.testing.assert_allclose(run.exponents, exact, atol=1e-7)
    if shake == DOUBLING:
        assert abs(run.exponents[0]) < 1e-7


def test_a_relay_around_a_plant_has_the_multipliers_of_the_relay_oscillation():
    """K. J. Astrom, Oscillations in systems with relay feedback, in: Adaptive Control, Filtering,
    and Signal Processing, IMA Vol. Math. Appl. 74, Springer 1995: half a period is the map
    (I - w C/(C w)) exp(A h), w the velocity at the switch."""
    n = len(ks.RELAY_PLANT)
    extended = np.zeros((n + 1, n + 1))
    extended[:n, :n], extended[:n, n] = ks.RELAY_PLANT, ks.RELAY_INPUT

    def half(h):
        e = expm(extended * h)
        return e[:n, :n], -np.linalg.solve(np.eye(n) + e[:n, :n], e[:n, n])

    h = brentq(lambda s: ks.RELAY_SEEN @ half(s)[1] + ks.RELAY_LEVEL, 1.0, 6.0, xtol=1e-14)
    flow, start = half(h)
    w = ks.RELAY_PLANT @ -start + ks.RELAY_INPUT
    across = np.eye(n) - np.outer(w, ks.RELAY_SEEN) / (ks.RELAY_SEEN @ w)
    sizes = np.sort(np.abs(np.linalg.eigvals(across @ flow)))[::-1][:2]
    exact = np.array([0.0, *(np.log(sizes) / h)])
    model = Model(ks.relay_loop(), {}, 1e-11)
    frame = follow_tangents(model, [0.0, 30 * h]).frame
    run = follow_tangents(model, 30 * h + np.array([0.0, 20 * h]), frame=frame)
    np.testing.assert_allclose(run.exponents, exact, atol=1e-7)


def test_sticking_takes_one_direction_away_for_good():
    run = follow_tangents(Model(ks.belt(beside=True), {}, 1e-10), [0.0, 50.0])
    assert run.events >= 8
    assert np.isfinite(run.growth[-1, 0])
    assert run.growth[-1, 1] == pytest.approx(-100.0, rel=1e-9)
    assert run.growth[-1, 2] == -np.inf


@pytest.mark.parametrize("modes", [(), (Mode("only"),)])
def test_a_motion_that_explodes_within_a_row_is_known_up_to_the_row_before(modes):
    """x' = x^2 from 1 is 1/(1 - t), and its tangent the square of it; with a mode: stiff steps."""
    x = State("x", "1", "", symbol("x") ** 2, start=1.0)
    made = Component("square", "", states=(x,), modes=modes)
    passes = follow_returns(Model(generate(made), {}, 1e-10), 0.0, 2.0, 0, np.inf, 0)
    assert (passes.diverged, passes.end) == (True, pytest.approx(1.0, abs=1e-6))
    run = follow_tangents(Model(generate(made), {}, 1e-10), np.linspace(0.0, 2.0, 9))
    assert run.diverged
    assert run.time.tolist() == [0.0, 0.25, 0.5, 0.75]
    np.testing.assert_allclose(run.growth[:, 0], -2 * np.log(1 - run.time), rtol=1e-7)


def explicitly(model, stop, count=None):
    n = len(model.x)
    frame = np.eye(n)[: count or n]
    return _followed(model, np.array([0.0, stop]), frame, FARTHEST, explicitly=True)


def test_the_order_is_eight_on_a_nonlinear_problem():
    """With steps of a length that is given, by a tolerance that accepts them all."""
    states = (
        State("x", "1", "angle", symbol("v"), start=1.0),
        State("v", "1", "speed", -sp.sin(symbol("x"))),
    )
    kernel = generate(Component("pendulum", "a swinging one", states=states))

    def swung(count):
        model, grid = Model(kernel, {}, 1e30), np.linspace(0.0, 8.0, count + 1)
        model.info[core.NEXT_STEP] = 8.0
        return _followed(model, grid, np.eye(2)[:1], np.inf, explicitly=True).states[-1]

    counts, exact = np.array([8, 12, 16, 24]), swung(1024)
    errors = [np.abs(swung(int(count)) - exact).max() for count in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 7.5 < order < 9.0


def test_the_exponents_of_a_linear_system_are_the_exact_ones():
    run = explicitly(Model(ks.linear(), ks.entries(MATRIX), 1e-10), 2.0)
    np.testing.assert_allclose(run.exponents, ks.stretched(MATRIX, 2.0), atol=1e-9)


def test_where_stiffness_limits_the_steps_nothing_is_done_and_nothing_moved():
    model = Model(ks.van_der_pol(), {"mu": 100.0}, 1e-9)
    start, notes = model.x.copy(), model.info.copy()
    with pytest.raises(_TooStiff):
        explicitly(model, 20.0)
    assert np.array_equal(model.x, start)
    assert np.array_equal(model.info, notes)


def stiffening():
    """x' = 1, y' = -e^x (y - sin x): the longer it runs, the faster y is."""
    x, y = symbol("x"), symbol("y")
    states = (
        State("x", "1", "x", sp.Integer(1), start=0.0),
        State("y", "1", "y", -sp.exp(x) * (y - sp.sin(x)), start=1.0),
    )
    return generate(Component("stiffening", "grows stiff", states=states))


def test_a_motion_that_becomes_stiff_on_its_way_is_followed_to_its_end():
    """The determinant of its tangents is exp(1 - e^T), and y ends at sin x within 1 / e^T."""
    kernel, stop = stiffening(), 12.0
    model = Model(kernel, {}, 1e-9)
    assert _may_be_explicit(model, 0.0)
    run = follow_tangents(model, [0.0, stop])
    assert not run.failure
    assert run.growth[-1].sum() == pytest.approx(-(np.exp(stop) - 1.0), rel=1e-6)
    assert run.states[-1] == pytest.approx([stop, np.sin(stop)], abs=1e-4)
