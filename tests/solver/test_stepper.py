"""The stiff stepper against exact solutions: order, L-stability, linear algebra, error control."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballscrew.solver import stepper


def integrate(rhs, jac, x0, t1, *, tolerance=1e-8, fixed_steps=0):
    """Run plain-Python copies of the compiled functions; with `fixed_steps` no error control."""
    x = np.array(x0, dtype=float)
    info = np.zeros(stepper.INFO_SIZE)
    work = np.zeros(stepper.work_size(len(x)))
    step, _ = stepper.build(rhs, jac)
    loose = 1e30 if fixed_steps else tolerance
    atol = np.full(len(x), loose)
    steps = max(1, fixed_steps)
    for k in range(steps):
        t0 = t1 * k / steps
        info[stepper.NEXT_STEP] = 0.0 if fixed_steps else info[stepper.NEXT_STEP]
        status = step(
            t0,
            t1 * (k + 1) / steps,
            x,
            np.zeros(1),
            np.zeros(1),
            atol,
            loose,
            work,
            info,
            1 if fixed_steps else 100_000,
        )
        assert status == stepper.DONE
    return x, info


@pytest.fixture(scope="module")
def pendulum():
    """x'' = -sin(x) + cos(2t): nonlinear and dependent on time."""
    from numba import njit

    @njit
    def rhs(t, x, u, p, dx):
        dx[0] = x[1]
        dx[1] = -math.sin(x[0]) + math.cos(2 * t)

    @njit
    def jac(t, x, u, p, J, ft):
        J[0, 0], J[0, 1], J[1, 0], J[1, 1] = 0.0, 1.0, -math.cos(x[0]), 0.0
        ft[0], ft[1] = 0.0, -2 * math.sin(2 * t)

    return rhs, jac


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
        np.linalg.norm(integrate(*pendulum, [1.0, 0.0], 2.0, fixed_steps=n)[0] - exact)
        for n in steps
    ]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 4.7 < order < 5.6


def test_error_control_keeps_the_error_near_the_tolerance_and_work_follows_it(pendulum):
    exact = integrate(*pendulum, [1.0, 0.0], 2.0, tolerance=1e-13)[0]
    errors, work = [], []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        x, info = integrate(*pendulum, [1.0, 0.0], 2.0, tolerance=tolerance)
        errors.append(np.max(np.abs(x - exact)) / tolerance)
        work.append(info[stepper.ACCEPTED])
    assert max(errors) < 20
    assert work == sorted(work)
    assert work[-1] < 300


def linear(matrix):
    from numba import njit

    matrix = np.array(matrix, dtype=float)
    n = len(matrix)

    @njit
    def rhs(t, x, u, p, dx):
        for i in range(n):
            dx[i] = 0.0
            for j in range(n):
                dx[i] += matrix[i, j] * x[j]

    @njit
    def jac(t, x, u, p, J, ft):
        for i in range(n):
            ft[i] = 0.0
            for j in range(n):
                J[i, j] = matrix[i, j]

    return rhs, jac


def test_a_decay_a_million_times_faster_than_the_step_is_damped_at_once():
    x, _ = integrate(*linear([[-1e6]]), [1.0], 1.0, fixed_steps=1)
    assert abs(x[0]) < 1e-4  # L-stable: the amplification goes to zero with h*lambda


def test_linear_systems_agree_with_the_matrix_exponential():
    from scipy.linalg import expm

    matrix = [[-1.0, 100.0, 0.0], [-100.0, -1.0, 3.0], [0.0, 0.0, -2e4]]
    x, _ = integrate(*linear(matrix), [1.0, 2.0, 3.0], 0.3, tolerance=1e-11)
    np.testing.assert_allclose(x, expm(0.3 * np.array(matrix)) @ [1, 2, 3], atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_factorize_and_solve_agree_with_numpy_where_rows_must_be_exchanged(n, seed):
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(n, n)) * 10.0 ** random.uniform(-4, 4, size=(n, n))
    right = random.normal(size=n)
    factors, pivots, x = matrix.copy(), np.zeros(n), right.copy()
    assert stepper.factorize(factors, pivots, n)
    stepper.solve_factorized(factors, pivots, n, x)
    residual = np.abs(matrix @ x - right).max()
    assert residual <= 1e-10 * max(1.0, np.abs(matrix).max() * np.abs(x).max())


def test_a_solution_that_blows_up_is_reported_and_not_returned():
    from numba import njit

    @njit
    def rhs(t, x, u, p, dx):
        dx[0] = x[0] * x[0]

    @njit
    def jac(t, x, u, p, J, ft):
        J[0, 0] = 2 * x[0]
        ft[0] = 0.0

    info = np.zeros(stepper.INFO_SIZE)
    step, _ = stepper.build(rhs, jac)
    status = step(
        0.0,
        2.0,
        np.array([1.0]),  # blows up at t = 1
        np.zeros(1),
        np.zeros(1),
        np.array([1e-9]),
        1e-9,
        np.zeros(stepper.work_size(1)),
        info,
        10_000,
    )
    assert status != stepper.DONE
    assert info[stepper.REACHED] == pytest.approx(1.0, abs=1e-3)
