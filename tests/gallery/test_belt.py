"""The belt: SciPy with events, exact pieces, and a theorem."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ballscrew.gallery.belt import findings as ours

EXACT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}


def sliding(curve, speed):
    """Rates of x and x' while the mass is slower than the belt."""
    return lambda _t, y: [y[1], curve(speed - y[1]) - ours.DAMPING * y[1] - y[0]]


def comes_back(curve, speed):
    """How far below the belt's speed the mass stays after it has slipped [m/s]."""
    leaves = ours.FS - ours.DAMPING * speed
    run = solve_ivp(
        sliding(curve, speed), (0.0, 9.0), [leaves, speed - 1e-9], dense_output=True, **EXACT
    )
    return speed - run.sol(np.linspace(2.0, 9.0, 7001))[1].max()


@pytest.mark.ci
@pytest.mark.parametrize(
    ("belt", "curve", "low", "high"),
    [(ours.FALLING, ours.falling, 1.75, 1.9), (ours.CLASSICAL, ours.classical, 1.85, 2.0)],
)
def test_the_cycle_ends_where_another_solver_s_slip_no_longer_meets_the_belt(
    belt, curve, low, high
):
    end = ours.end_of_cycle(belt, low, high)
    assert comes_back(curve, end - 2e-4) < 0.0 < comes_back(curve, end + 2e-4)


def damped(speed, zeta):
    """How far below the belt the mass stays after a slip under Coulomb friction, exactly [m/s]."""
    pole = -zeta + 1j * np.sqrt(1 - zeta**2)
    start = ours.FS - ours.FC - 2 * zeta * speed
    c = start - 1j * (speed + zeta * start) / pole.imag
    when = (np.pi / 2 - np.angle(c * pole**2)) / pole.imag
    while when <= 1e-9:
        when += 2 * np.pi / pole.imag
    return speed - (c * pole * np.exp(pole * when)).real


def test_coulomb_s_cycle_ends_where_the_exact_slip_says_and_the_formula_leaves_out_three_zeta():
    exact = {z: brentq(damped, 0.05, 30.0, (z,)) for z in (0.001, 0.005, 0.01)}
    assert ours.end_of_cycle(ours.COULOMB, 1.9, 2.05, c=0.01) == pytest.approx(
        exact[0.005], abs=1e-4
    )
    for zeta, speed in exact.items():
        formula = (ours.FS - ours.FC) / np.sqrt(4 * np.pi * zeta)
        assert formula / speed - 1 == pytest.approx(3 * zeta, rel=0.05)


speeds = st.floats(0.1, 3.0)


@pytest.mark.ci
@settings(max_examples=10, deadline=None, derandomize=True)
@given(speeds, st.floats(0.1, 1.0), st.floats(0.5, 3.0), st.floats(0.2, 2.0), st.floats(-2.0, 2.0))
def test_without_a_fall_every_motion_comes_to_rest_where_the_spring_holds_the_friction(
    speed, damping, stiffness, friction, start
):
    values = {"vb": speed, "c": damping, "k": stiffness, "Fc": friction, "Fs": friction}
    found = ours.verdict(ours.COULOMB, **values, x_start=start, w_start=-start)
    assert found.kind.value == "isolated fixed point", found.evidence
    assert found.equilibrium.state == pytest.approx([friction / stiffness, -speed], abs=1e-6)
