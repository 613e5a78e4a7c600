"""The stiff stepper against exact solutions: order, L-stability, linear algebra, error control."""

import itertools

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, State, symbol


def system(*rates):
    """A system of states x0, x1, ..."""
    names = [f"x{i}" for i in range(len(rates))]
    states = tuple(State(n, "1", n, sp.sympify(r)) for n, r in zip(names, rates, strict=True))
    return generate(Component("test", "test", states=states)).system()


def linear(matrix):
    return system(*(sp.Matrix(matrix) * sp.Matrix([symbol(f"x{i}") for i in range(len(matrix))])))


def integrate(made, x0, t1, *, tolerance=1e-8, fixed_steps=0):
    """Go to `t1`; with `fixed_steps` no error control."""
    x, info = np.array(x0, dtype=float), np.zeros(core.INFO_SIZE)
    loose = 1e30 if fixed_steps else tolerance
    given = np.zeros(1), np.zeros(1), np.full(len(x), loose), loose, info
    for start, end in itertools.pairwise(np.linspace(0.0, t1, max(1, fixed_steps) + 1)):
        info[core.NEXT_STEP] = 0.0
        assert made.advance(start, end, x, *given, 1 if fixed_steps else 100_000) == core.DONE
    return x, info


@pytest.fixture(scope="module")
def pendulum():
    """x'' = -sin(x) + cos(2t): nonlinear and dependent on time; its state after 2 s by SciPy."""

    def rates(t, x):
        return [x[1], -np.sin(x[0]) + np.cos(2 * t)]

    exact = solve_ivp(rates, (0, 2), [1.0, 0.0], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return system(symbol("x1"), -sp.sin(symbol("x0")) + sp.cos(2 * TIME)), exact


def test_order_five_is_reached_on_a_nonlinear_problem_with_time(pendulum):
    made, exact = pendulum
    steps = np.array([10, 20, 40, 80])
    errors = [
        np.linalg.norm(integrate(made, [1.0, 0.0], 2.0, fixed_steps=n)[0] - exact) for n in steps
    ]
    assert 4.7 < -np.polyfit(np.log(steps), np.log(errors), 1)[0] < 5.6


def test_error_control_keeps_the_error_near_the_tolerance_and_work_follows_it(pendulum):
    made, exact = pendulum
    errors, work = [], []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        x, info = integrate(made, [1.0, 0.0], 2.0, tolerance=tolerance)
        errors.append(np.max(np.abs(x - exact)) / tolerance)
        work.append((info[core.ACCEPTED], info[core.REJECTED]))
    assert max(errors) < 20
    assert work == [(6, 2), (13, 2), (31, 2), (76, 2)]  # its control has not changed


def test_a_decay_a_million_times_faster_than_the_step_is_damped_at_once():
    x, _ = integrate(linear([[-1e6]]), [1.0], 1.0, fixed_steps=1)
    assert abs(x[0]) < 1e-4  # L-stable: the amplification goes to zero with h*lambda


def test_linear_systems_agree_with_the_matrix_exponential_where_rows_must_be_exchanged():
    matrix = [[-1.0, 100.0, 0.0], [-100.0, -1.0, 3.0], [0.0, 0.0, -2e4]]
    x, _ = integrate(linear(matrix), [1.0, 2.0, 3.0], 0.3, tolerance=1e-11)
    np.testing.assert_allclose(x, expm(0.3 * np.array(matrix)) @ [1, 2, 3], atol=1e-9)
    random = np.random.default_rng(1).normal(size=(6, 6))
    skew = 20.0 * (random - random.T) - np.eye(6)
    x, _ = integrate(linear(skew), np.arange(6.0), 1.0, tolerance=1e-12)
    np.testing.assert_allclose(x, expm(skew) @ np.arange(6.0), atol=1e-9)


def test_slivers_of_calls_leave_no_step_that_is_too_small_for_the_next():
    """As where the sum of many steps misses the end by round-off."""
    made, x, info = linear([[-1.0]]), np.ones(1), np.zeros(core.INFO_SIZE)
    given = np.zeros(1), np.zeros(1), np.full(1, 1e-9), 1e-9, info, 1000
    seen = []
    for a, b in itertools.pairwise([0.0, 1e-14, 1.0, 1.0 + 2.3e-16, 1e3]):
        assert made.advance(a, b, x, *given) == core.DONE
        seen.append(x[0])
    assert seen[1] == pytest.approx(np.exp(-1.0), rel=1e-8)
    assert seen[3] == pytest.approx(0.0, abs=1e-7)
