"""The belt: SciPy with events, exact pieces, reversed time, bSTAB's own rule, and two theorems."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ballscrew
from ballscrew.gallery.belt.cycles import (
    CLASSICAL,
    COULOMB,
    DAHL,
    DAMPING,
    FALLING,
    FC,
    FS,
    classical,
    end_of_cycle,
    exponential_turning_point,
    falling,
    gaussian_turning_points,
    lugre_turning_point,
    verdict,
)

EXACT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}


def sliding(curve, speed):
    """Rates of x and x' while the mass is slower than the belt."""
    return lambda _t, y: [y[1], curve(speed - y[1]) - DAMPING * y[1] - y[0]]


def comes_back(curve, speed):
    """How far below the belt's speed the mass stays after it has slipped [m/s]."""
    leaves = FS - DAMPING * speed
    run = solve_ivp(
        sliding(curve, speed), (0.0, 9.0), [leaves, speed - 1e-9], dense_output=True, **EXACT
    )
    return speed - run.sol(np.linspace(2.0, 9.0, 7001))[1].max()


@pytest.mark.ci
@pytest.mark.parametrize(
    ("belt", "curve", "low", "high"),
    [(FALLING, falling, 1.75, 1.9), (CLASSICAL, classical, 1.85, 2.0)],
)
def test_the_cycle_ends_where_another_solver_s_slip_no_longer_meets_the_belt(
    belt, curve, low, high
):
    end = end_of_cycle(belt, low, high)
    assert comes_back(curve, end - 2e-4) < 0.0 < comes_back(curve, end + 2e-4)


def slope(curve, speed):
    return (curve(speed + 1e-5) - curve(speed - 1e-5)) / 2e-5


def test_the_formulas_are_where_the_slope_is_the_damping():
    low, high = gaussian_turning_points()
    for curve, speed in (
        (falling, exponential_turning_point()),
        (classical, low),
        (classical, high),
    ):
        assert slope(curve, speed) == pytest.approx(-DAMPING, rel=1e-6)


def lugre_rates(speed):
    def rates(_t, y):
        x, v, z = y
        w = v - speed
        change = w - 1e3 * abs(w) / classical(w) * z
        return [v, -x - DAMPING * v - 1e3 * z - 10.0 * change, change]

    return rates


def test_at_lugre_s_turning_point_a_pair_of_eigenvalues_is_imaginary():
    speed = lugre_turning_point()
    rest = np.array([classical(speed), 0.0, -classical(speed) / 1e3])
    f, h = lugre_rates(speed), 1e-7
    columns = [
        (np.array(f(0, rest + h * e)) - np.array(f(0, rest - h * e))) / (2 * h) for e in np.eye(3)
    ]
    values = np.linalg.eigvals(np.column_stack(columns))
    assert np.sort(values.real)[-2:] == pytest.approx(0.0, abs=1e-6)


def damped(speed, zeta):
    """How far below the belt the mass stays after a slip under Coulomb friction, exactly [m/s]."""
    pole = -zeta + 1j * np.sqrt(1 - zeta**2)
    start = FS - FC - 2 * zeta * speed
    c = start - 1j * (speed + zeta * start) / pole.imag
    when = (np.pi / 2 - np.angle(c * pole**2)) / pole.imag
    while when <= 1e-9:
        when += 2 * np.pi / pole.imag
    return speed - (c * pole * np.exp(pole * when)).real


def test_coulomb_s_cycle_ends_where_the_exact_slip_says_and_the_formula_leaves_out_three_zeta():
    exact = {z: brentq(damped, 0.05, 30.0, (z,)) for z in (0.001, 0.005, 0.01)}
    assert end_of_cycle(COULOMB, 1.9, 2.05, c=0.01) == pytest.approx(exact[0.005], abs=1e-4)
    for zeta, speed in exact.items():
        formula = (FS - FC) / np.sqrt(4 * np.pi * zeta)
        assert formula / speed - 1 == pytest.approx(3 * zeta, rel=0.05)


def test_a_mass_that_the_belt_carries_when_one_looks_is_not_taken_for_one_at_rest():
    assert verdict(CLASSICAL, vb=1.5).kind.value == "limit cycle"
    assert verdict(DAHL, vb=1.5).kind.value == "isolated fixed point"


def test_a_slow_belt_is_quiet_under_the_gaussian_fall_alone():
    assert verdict(CLASSICAL, vb=0.015).kind.value == "isolated fixed point"
    assert verdict(FALLING, vb=0.015).kind.value == "limit cycle"


speeds = st.floats(0.1, 3.0)


@pytest.mark.ci
@settings(max_examples=10, deadline=None, derandomize=True)
@given(speeds, st.floats(0.1, 1.0), st.floats(0.5, 3.0), st.floats(0.2, 2.0), st.floats(-2.0, 2.0))
def test_without_a_fall_every_motion_comes_to_rest_where_the_spring_holds_the_friction(
    speed, damping, stiffness, friction, start
):
    values = {"vb": speed, "c": damping, "k": stiffness, "Fc": friction, "Fs": friction}
    found = verdict(COULOMB, **values, x_start=start, w_start=-start)
    assert found.kind.value == "isolated fixed point", found.evidence
    assert found.equilibrium.state == pytest.approx([friction / stiffness, -speed], abs=1e-6)


@pytest.mark.ci
@settings(max_examples=10, deadline=None, derandomize=True)
@given(speeds, st.floats(0.02, 1.0), st.floats(0.1, 2.0), st.floats(0.2, 2.0))
def test_sliding_is_stable_if_and_only_if_friction_falls_by_less_than_the_damper_takes(
    speed, damping, fall, over
):
    slope = -fall / over * np.exp(-speed / over)
    if abs(slope + damping) < 0.02:
        return
    rest = 0.5 + fall * np.exp(-speed / over)
    values = {"vb": speed, "c": damping, "Fs": 0.5 + fall, "v0": over}
    found = ballscrew.lyapunov(
        "none",
        FALLING,
        stop=5.0,
        plant_values={**values, "x_start": rest + 1e-4, "w_start": -speed},
    ).motion
    assert (found.kind.value == "isolated fixed point") == (slope + damping > 0), found.evidence
