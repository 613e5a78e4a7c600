"""Friction laws against the solutions of their equations, and where they are not passive."""

import math

import numpy as np
import pytest
from prescribed_motion import motion_kernel, prescribed_friction, ways
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ballscrew.plant.directional_lugre import PARAMETERS as DIRECTIONAL
from ballscrew.plant.law import claims
from ballscrew.plant.maxwell_slip import PARAMETERS
from ballscrew.solver.component import symbol

SIGMA, MOST = 87750.0, 2.0


def course(alpha=1.0, sign=1.0):
    grid = np.linspace(0, 0.1, 201)
    return prescribed_friction(
        "dahl", grid, np.full(201, sign * 1e-3), {"alpha": alpha}, tolerance=1e-10
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_from_rest_is_eq_2_5_and_2_6_with_their_signs_corrected(sign):
    """F = +-Fc (1 - exp(-sigma |x| / Fc)); printed, 2.5 has a growing exponential."""
    got = course(sign=sign)
    exact = sign * MOST * (1 - np.exp(-SIGMA * np.abs(got.outputs["x"]) / MOST))
    np.testing.assert_allclose(got.outputs["friction"], exact, atol=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 0.5, 2.0])
def test_any_exponent_follows_the_solution_of_its_equation(alpha):
    """(1 - F/Fc)^(1 - alpha) = 1 - (1 - alpha) sigma x/Fc, and Fc once that has reached zero."""
    got = course(alpha)
    left = np.maximum(1 - (1 - alpha) * SIGMA * got.outputs["x"] / MOST, 0.0)
    exact = MOST * (1 - left ** (1 / (1 - alpha)))
    np.testing.assert_allclose(got.outputs["friction"], exact, atol=1e-5 * MOST)


def test_friction_put_outside_its_bounds_comes_back():
    for alpha in (0.5, 1.0, 2.0):
        start = {"alpha": alpha, "z_start": 1.2 * MOST / SIGMA}
        friction = prescribed_friction("dahl", *ways((1e-3, 5e-3)), start).outputs["friction"]
        assert friction[0] == pytest.approx(1.2 * MOST)
        assert friction[-1] == pytest.approx(MOST, rel=5e-3)


# -- Bliman-Sorine, with row 6 of Table 2.7 ------------------------------------------------------


F1, F2, EPS, ETA = 19.875, 17.8227, 0.000121, 0.9063


def along(length, speed=1e-3, points=20001):
    grid = np.linspace(0, length / speed, points)
    return prescribed_friction(
        "bliman_sorine", grid, np.full(points, speed), tolerance=1e-10
    ).outputs


def test_friction_from_rest_is_the_sum_of_two_exponentials():
    got = along(1.5e-3, points=301)
    x = got["x"]
    exact = F1 * (1 - np.exp(-x / (ETA * EPS))) - F2 * (1 - np.exp(-x / EPS))
    np.testing.assert_allclose(got["friction"], exact, atol=1e-7)


def test_the_peak_after_a_reversal_is_the_one_that_the_map_of_eq_2_8_takes():
    time = np.r_[0.0, 5.0, 5.0 + np.linspace(0, 1.0, 20001)]
    velocity = np.r_[-1e-3, -1e-3, np.full(20001, 1e-3)]
    got = prescribed_friction("bliman_sorine", time, velocity, tolerance=1e-10)
    assert got.outputs["friction"].max() == pytest.approx(2.502, abs=5e-4)


# -- LuGre and its relatives ---------------------------------------------------------------------


S0, S1, S2, FC, FS, VS = 66967.231, 344.56, 173.0, 1.284, 2.35, 1.13975e-3


def g(v):
    return FC + (FS - FC) * np.exp(-((v / VS) ** 2))


@pytest.mark.parametrize(("name", "bound"), [("lugre", 1e-8), ("modified_lugre", 1e-4)])
@pytest.mark.parametrize("v", [2e-4, -5e-3])
def test_at_a_constant_velocity_the_deflection_decays_to_its_end_as_an_exponential(name, bound, v):
    grid = np.linspace(0, 5 * g(v) / S0 / abs(v), 101)
    got = prescribed_friction(name, grid, np.full(101, v), tolerance=1e-10).outputs
    z = math.copysign(g(v) / S0, v) * (1 - np.exp(-S0 * abs(v) * grid / g(v)))
    friction = S0 * z + S1 * (v - S0 * abs(v) / g(v) * z) + S2 * v
    np.testing.assert_allclose(got["z"], z, atol=bound * FS / S0)
    np.testing.assert_allclose(got["friction"], friction, atol=bound * FS)


def test_with_both_directions_alike_the_directional_law_is_the_modified_one():
    same = {p.name: v for p in DIRECTIONAL for n, v in NOMINAL.items() if p.name[:-4] == n}
    assert len(same) == 12
    grid = np.linspace(0, 2.0, 801)
    velocity = 2e-3 * np.sin(9 * grid)
    one = prescribed_friction("directional_lugre", grid, velocity, same).outputs["friction"]
    other = prescribed_friction("modified_lugre", grid, velocity).outputs["friction"]
    np.testing.assert_allclose(one, other, atol=1e-7)


NOMINAL = {"sigma0": S0, "sigma1": S1, "sigma2": S2, "Fc": FC, "Fs": FS, "Vs": VS}
TABLE_2_3 = {
    1: {"Fc": 1.11, "Fs": 2.3, "Vs": 0.001943, "sigma2": 193.4},
    -1: {"Fc": 1.458, "Fs": 2.4, "Vs": 0.0003365, "sigma2": 152.6},
}


@pytest.mark.parametrize("direction", [1, -1])
def test_each_direction_slides_on_its_own_column_of_table_2_3(direction):
    q = TABLE_2_3[direction]
    for speed in (2e-4, 1e-3, 5e-3):
        curve = q["Fc"] + (q["Fs"] - q["Fc"]) * math.exp(-((speed / q["Vs"]) ** 2))
        course = prescribed_friction("directional_lugre", *ways((direction * speed, 2e-3)))
        expected = direction * (curve + q["sigma2"] * speed)
        assert course.outputs["friction"][-1] == pytest.approx(expected, rel=1e-4)


def test_different_stiffness_by_side_gives_out_no_work_in_a_small_swing():
    """The stiffness goes with the side on which the bristles are bent, not with the motion."""
    values = {"sigma0_pos": 1e5, "sigma0_neg": 5e4, "sigma1_pos": 0.0, "sigma1_neg": 0.0}
    grid = np.linspace(0, 20.0, 20001)
    course = prescribed_friction("directional_lugre", grid, 1e-5 * np.cos(2 * np.pi * grid), values)
    assert np.min(np.diff(course.outputs["work"][::1000])) > 0
    assert np.max(np.abs(np.diff(course.outputs["friction"]))) < 2 * 1e5 * 1e-5 * 1e-3


# -- Maxwell-slip, as published with its switches ------------------------------------------------


P = {p.name: p.default for p in PARAMETERS}


def curve(v):
    return P["Fc"] + (P["Fs"] - P["Fc"]) * np.exp(-((v / P["Vs"]) ** 2))


def element(stiffness, share, amplitude, w, grid):
    """Force of one element while v = amplitude sin(w t): sticks, slips, sticks again at turns."""

    def v(t):
        return amplitude * np.sin(w * t)

    def x(t):
        return amplitude / w * (1 - np.cos(w * t))

    force, at_start = np.zeros_like(grid), 0.0
    half = np.pi / w
    for turn in range(round(grid[-1] / half)):
        start, end, sign = turn * half, (turn + 1) * half, (-1) ** turn

        def stuck(t, at_start=at_start, start=start):
            return at_start + stiffness * (x(t) - x(start))

        def over(t, stuck=stuck, sign=sign):
            return stuck(t) * sign - share * curve(v(t))

        fine = np.linspace(start, end, 4001)
        beyond = np.flatnonzero(over(fine) > 0)
        slips = brentq(over, *fine[[beyond[0] - 1, beyond[0]]], xtol=1e-15) if beyond.size else end
        inside = (grid >= start) & (grid <= slips)
        force[inside] = stuck(grid[inside])
        at_start = stuck(slips)
        if slips < end:
            sliding = solve_ivp(
                lambda t, f, sign=sign: P["C"] * (share * sign - f / curve(v(t))),
                (slips, end),
                [at_start],
                "Radau",
                rtol=1e-8,
                atol=1e-10,
                dense_output=True,
            )
            inside = (grid > slips) & (grid <= end)
            force[inside] = sliding.sol(grid[inside])[0]
            at_start = sliding.y[0, -1]
    return force


@pytest.mark.ci
@pytest.mark.parametrize(("amplitude", "w"), [(1e-3, 30.0), (1e-5, 5.0)])
def test_slip_as_a_state_differs_from_slip_as_a_switch_by_half_a_millinewton_at_most(amplitude, w):
    """Of 2.35 N; measured: 0.36 mN at most, 0.06 mN in the mean square."""
    grid = np.linspace(0, 6 * np.pi / w, 6001)
    v = amplitude * np.sin(w * grid)
    exact = P["sigma2"] * v
    for i in range(1, 5):
        exact += element(P[f"k{i}"], P[f"alpha{i}"], amplitude, w, grid)
    error = prescribed_friction("maxwell_slip", grid, v).outputs["friction"] - exact
    assert np.max(np.abs(error)) < 5e-4
    assert np.sqrt(np.mean(error**2)) < 1e-4


# -- where a law gives out work: outside of what it declares ---------------------------------------

PULSE = ways((1e-4, 1.1e-4), (2.0, 9.6e-6))  # bent slowly, then 2 m/s over ten micrometres
LET_GO = ways((1e-5, 1e-5), (-1e-9, 1e-5))  # bent by 10 um in a second, let go of at 1 nm/s
# loaded fast, left to creep while the elements take on the larger force of rest, let go
CREPT = ways((1e-2, 2e-5), (1e-6, 2e-7), (-1e-3, 2e-5))


@pytest.mark.parametrize(
    ("name", "motion", "values", "least"),
    [
        ("bliman_sorine", ways((1e-3, 1e-2)), {"f1": 17.0}, 0.0),  # the sliding force pushes
        ("lugre", PULSE, {}, 3e-4),
        ("modified_lugre", LET_GO, {}, 2e-6),  # slower than its sign function
        ("maxwell_slip", CREPT, {"Fc": 0.3, "sigma2": 0.0}, 2e-5),
    ],
)
def test_a_law_gives_out_work(name, motion, values, least):
    assert prescribed_friction(name, *motion, values).outputs["work"][-1] < -least


@pytest.mark.parametrize(
    ("motion", "values", "declared"),
    [
        (PULSE, {"sigma1": (1 - 1e-9) * S2 * FC / (FS - FC)}, True),
        (PULSE, {"Fs": FC, "sigma2": 0.0}, True),  # at the limit
        (LET_GO, {}, False),
    ],
)
def test_the_lugre_law_gives_out_none_below_its_limit_or_to_a_slow_motion(motion, values, declared):
    assert prescribed_friction("lugre", *motion, values).outputs["work"][-1] > 0
    # an axis may be a million times softer and smoother
    assert all(p.minimum <= 1e-6 * p.default for p in motion_kernel("lugre").parameters)
    numbers = {symbol(name): value for name, value in (NOMINAL | values).items()}
    assert bool(claims("lugre").passive_if.subs(numbers)) == declared
