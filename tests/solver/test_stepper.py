"""The stiff stepper against exact solutions: order, L-stability, linear algebra, error control.

Each on both roads: the compiled core, and the plain Python that stands in for it.
"""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ballscrew.solver import core, stepper
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, State, symbol


def system(rates, road):
    """A system of states x0, x1, ... on one of the roads."""
    names = [f"x{i}" for i in range(len(rates))]
    states = tuple(State(n, "1", n, sp.sympify(r)) for n, r in zip(names, rates, strict=True))
    kernel = generate(Component("test", "test", states=states))
    if road == "core":
        return kernel.system()
    space = {}
    exec(kernel.source, space)
    return stepper.PlainSystem(SimpleNamespace(**space), len(rates), kernel.events)


def integrate(made, x0, t1, *, tolerance=1e-8, fixed_steps=0):
    """Go to `t1`; with `fixed_steps` no error control."""
    x = np.array(x0, dtype=float)
    info = np.zeros(core.INFO_SIZE)
    loose = 1e30 if fixed_steps else tolerance
    steps = max(1, fixed_steps)
    for k in range(steps):
        info[core.NEXT_STEP] = 0.0 if fixed_steps else info[core.NEXT_STEP]
        status = made.advance(
            t1 * k / steps,
            t1 * (k + 1) / steps,
            x,
            np.zeros(1),
            np.zeros(1),
            np.full(len(x), loose),
            loose,
            info,
            1 if fixed_steps else 100_000,
        )
        assert status == core.DONE
    return x, info


@pytest.fixture(scope="module", params=["core", "plain"])
def road(request):
    return request.param


def test_an_interval_of_round_off_s_length_does_not_hold_up_the_next(road):
    made, x, info = system([-symbol("x0")], road), np.ones(1), np.zeros(core.INFO_SIZE)
    given = np.zeros(1), np.zeros(1), np.full(1, 1e-9), 1e-9, info, 1000
    for start, end in ((0.0, 1e-14), (1e-14, 1.0)):
        assert made.advance(start, end, x, *given) == core.DONE
    assert x[0] == pytest.approx(np.exp(-1.0), rel=1e-8)


@pytest.fixture(scope="module")
def pendulum(road):
    """x'' = -sin(x) + cos(2t): nonlinear and dependent on time."""
    return system([symbol("x1"), -sp.sin(symbol("x0")) + sp.cos(2 * TIME)], road)


def linear(matrix, road):
    states = sp.Matrix([symbol(f"x{i}") for i in range(len(matrix))])
    return system(list(sp.Matrix(matrix) * states), road)


def test_order_five_is_reached_on_a_nonlinear_problem_with_time(pendulum):
    exact = solve_ivp(
        lambda t, x: [x[1], -math.sin(x[0]) + math.cos(2 * t)],
        (0, 2),
        [1.0, 0.0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
    ).y[:, -1]
    steps = np.array([10, 20, 40, 80])
    errors = [
        np.linalg.norm(integrate(pendulum, [1.0, 0.0], 2.0, fixed_steps=n)[0] - exact)
        for n in steps
    ]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 4.7 < order < 5.6


def test_error_control_keeps_the_error_near_the_tolerance_and_work_follows_it(pendulum):
    exact = integrate(pendulum, [1.0, 0.0], 2.0, tolerance=1e-13)[0]
    errors, work = [], []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        x, info = integrate(pendulum, [1.0, 0.0], 2.0, tolerance=tolerance)
        errors.append(np.max(np.abs(x - exact)) / tolerance)
        work.append(info[core.ACCEPTED])
    assert max(errors) < 20
    assert work == sorted(work)
    assert work[-1] < 300


def test_a_decay_a_million_times_faster_than_the_step_is_damped_at_once(road):
    x, _ = integrate(linear([[-1e6]], road), [1.0], 1.0, fixed_steps=1)
    assert abs(x[0]) < 1e-4  # L-stable: the amplification goes to zero with h*lambda


def test_linear_systems_agree_with_the_matrix_exponential(road):
    matrix = [[-1.0, 100.0, 0.0], [-100.0, -1.0, 3.0], [0.0, 0.0, -2e4]]
    x, _ = integrate(linear(matrix, road), [1.0, 2.0, 3.0], 0.3, tolerance=1e-11)
    np.testing.assert_allclose(x, expm(0.3 * np.array(matrix)) @ [1, 2, 3], atol=1e-9)


def test_both_roads_give_the_same_numbers():
    rates = [symbol("x1"), -sp.sin(symbol("x0")) + sp.cos(2 * TIME) - 500 * symbol("x1") ** 3]
    (fast, told), (slow, plain) = (
        integrate(system(rates, road), [1.0, 0.5], 3.0) for road in ("core", "plain")
    )
    assert list(fast) == list(slow)
    assert list(told) == list(plain)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_factorize_and_solve_agree_with_numpy_where_rows_must_be_exchanged(n, seed):
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(n, n)) * 10.0 ** random.uniform(-4, 4, size=(n, n))
    right = random.normal(size=n)
    factors, pivots, x = matrix.tolist(), [0] * n, right.tolist()
    assert stepper.factorize(factors, pivots)
    stepper.solve_factorized(factors, pivots, x)
    residual = np.abs(matrix @ np.array(x) - right).max()
    assert residual <= 1e-10 * max(1.0, np.abs(matrix).max() * np.abs(x).max())


def test_a_solution_that_blows_up_is_reported_and_not_returned(road):
    info = np.zeros(core.INFO_SIZE)
    status = system([symbol("x0") ** 2], road).advance(
        0.0,
        2.0,
        np.array([1.0]),  # blows up at t = 1
        np.zeros(1),
        np.zeros(1),
        np.array([1e-9]),
        1e-9,
        info,
        10_000,
    )
    assert status != core.DONE
    assert info[core.REACHED] == pytest.approx(1.0, abs=1e-3)


def test_a_sliver_of_a_call_leaves_no_step_that_is_too_small_for_the_next(road):
    """As where the sum of many steps misses the end by round-off."""
    made = linear([[-1.0]], road)
    x, info = np.ones(1), np.zeros(core.INFO_SIZE)
    ends = [0.0, 1.0, 1.0 + 2.3e-16, 1e3]
    for a, b in itertools.pairwise(ends):
        given = np.zeros(1), np.zeros(1), np.full(1, 1e-8), 1e-8, info, 1000
        assert made.advance(a, b, x, *given) == core.DONE
    assert x[0] == pytest.approx(0.0, abs=1e-7)
