"""Verdicts and exponents of systems whose answers are in the literature, or exact."""

from functools import cache

import numpy as np
import pytest
from known_systems import (
    BELT_SPEED,
    FALLING,
    belt,
    bouncing_ball,
    dry_friction,
    elastic_ball,
    entries,
    linear,
    lorenz,
    maker,
    relay_loop,
    van_der_pol,
)
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.kernel import Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.classify import classify_attractor
from ballscrew.stability.equilibria import equilibrium_near
from ballscrew.stability.lyapunov import loop_lyapunov, lyapunov
from ballscrew.stability.map_plan import MapPlan, read_axis, run_cell

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once

FOCUS = [[0.0, 1.0, 0.0], [-1.0, -0.1, 0.0], [0.0, 0.0, -5.0]]
LINE = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -2.0]]
SADDLE = [[0.5, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -2.0]]
CENTRE = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
RUNS = {
    "stable focus": (linear, entries(FOCUS), 50.0, 1e-10),
    "line of equilibria": (linear, entries(LINE), 20.0, 1e-10),
    "saddle": (linear, entries(SADDLE), 50.0, 1e-10),
    "centre": (linear, entries(CENTRE), 50.0, 1e-10),
    "Lorenz": (lorenz, {}, 50.0, 1e-9),
    "Van der Pol": (van_der_pol, {}, 60.0, 1e-10),
    "belt": (belt, {}, 50.0, 1e-10),
    "dry friction": (dry_friction, {}, 100.0, 1e-10),
    "relay": (relay_loop, {}, 50.0, 1e-10),
    "ball on a table": (bouncing_ball, {}, 50.0, 1e-10),
}


@cache
def run(name):
    make, values, stop, tolerance = RUNS[name]
    return lyapunov(maker(make(), values), stop, tolerance, label=name)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("stable focus", Kind.FIXED_POINT),
        ("line of equilibria", Kind.LINE),
        ("saddle", Kind.DIVERGES),
        ("Lorenz", Kind.CHAOS),
        ("Van der Pol", Kind.CYCLE),
        ("belt", Kind.CYCLE),
        ("dry friction", Kind.CYCLE),
        ("relay", Kind.CYCLE),
        ("ball on a table", Kind.CYCLE),
    ],
)
def test_the_verdict_is_the_known_one(name, kind):
    motion = run(name).motion
    assert motion.kind is kind, motion.evidence


def test_what_a_belt_carries_is_not_at_rest_though_all_its_eigenvalues_are_zero():
    model = Model(belt(), {}, 1e-10)
    model.advance(0.0, 40.0)
    assert model.mode == "stick"
    found = equilibrium_near(model, 40.0)
    assert found is not None
    assert found.neutral == 2
    assert found.drift == pytest.approx(BELT_SPEED)


def test_a_centre_is_no_torus():
    """Its orbits close, but there are many side by side: it is no cycle either."""
    motion = run("centre").motion
    assert motion.kind is Kind.UNDECIDED, motion.evidence


def test_lorenz_has_the_exponents_of_the_literature():
    """0.9056, 0, -14.5723: J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003; his page
    https://sprott.physics.wisc.edu/chaos/lorenzle.htm has 0.906, 0, -14.572 from a run of 10^6."""
    motion = run("Lorenz").motion
    assert np.all(motion.limit_error < 0.05)
    assert np.all(np.abs(motion.limit - [0.9056, 0.0, -14.5723]) < 4.0 * motion.limit_error)
    assert run("Lorenz").exponents.sum() == pytest.approx(-41.0 / 3.0, rel=1e-9)


def floquet(mu, w, start):
    """Period and the exponent that is not zero of x'' = mu (1 - x^2) x' - w^2 x, by DOP853.

    The exponent is the divergence's mean over a period.
    """

    def rhs(_, s):
        return [s[1], mu * (1 - s[0] ** 2) * s[1] - w**2 * s[0], mu * (1 - s[0] ** 2)]

    def upwards(_, s):
        return s[0]

    upwards.direction = 1
    course = solve_ivp(
        rhs, (0.0, 200.0), [start, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-12, events=upwards
    )
    times, sums = course.t_events[0][-2:], course.y_events[0][-2:, 2]
    period = times[1] - times[0]
    return period, (sums[1] - sums[0]) / period


def test_van_der_pols_cycle_has_the_exponents_and_the_period_of_another_solver():
    motion = run("Van der Pol").motion
    period, exponent = floquet(1.0, 1.0, 2.0)
    assert motion.period == pytest.approx(period, rel=1e-7)
    np.testing.assert_allclose(motion.limit, [0.0, exponent], atol=1e-6)


def test_a_belts_cycle_has_zero_and_minus_infinity_and_the_period_of_another_solver():
    def slipping(_, s):
        return [s[1], -s[0] + 1.0 / (1.0 + FALLING * (BELT_SPEED - s[1]))]

    def sticks(_, s):
        return s[1] - BELT_SPEED

    sticks.terminal, sticks.direction = True, 1
    # just past the corner where both equations agree: x = 1 + tiny pulls it off the belt
    slip = solve_ivp(
        slipping,
        (0.0, 100.0),
        [1.0 + 1e-9, BELT_SPEED - 1e-12],
        "DOP853",
        rtol=1e-12,
        atol=1e-13,
        events=sticks,
    )
    period = slip.t[-1] + (1.0 - slip.y[0, -1]) / BELT_SPEED
    motion = run("belt").motion
    assert motion.period == pytest.approx(period, rel=1e-5)
    assert abs(motion.limit[0]) < 1e-6
    assert motion.limit[1] == -np.inf


def test_a_ball_that_loses_nothing_bounces_for_ever_and_on_no_cycle_of_its_own():
    """Its period grows with its energy, so a disturbance grows, too, but not exponentially."""
    model = maker(elastic_ball())(1e-9)
    before = model.tolerance
    motion = classify_attractor(model, 0.0, 10.0)
    assert motion.kind is Kind.UNDECIDED, motion.evidence
    assert "one of a family" in motion.evidence
    np.testing.assert_allclose(motion.limit, [0.0, 0.0], atol=1e-9)
    assert model.tolerance == before


def test_the_limits_at_rest_are_the_real_parts_of_the_eigenvalues():
    focus, line = run("stable focus").motion, run("line of equilibria").motion
    np.testing.assert_allclose(focus.limit, [-0.05, -0.05, -5.0], rtol=1e-9)
    np.testing.assert_allclose(line.limit, [0.0, -1.0, -2.0], rtol=1e-9)
    assert line.equilibrium.neutral == 1
    # x' = y, y' = -y from (1, 1): it comes to rest at x = 2
    np.testing.assert_allclose(line.equilibrium.state, [2.0, 0.0, 0.0], atol=1e-7)


def test_the_figures_of_a_linear_system_are_the_exact_ones_in_bits():
    run = lyapunov(maker(linear(), entries(np.diag([-1.0, -2.0, -4.0]))), 2.0, 1e-10)
    bits, figures = np.array([-1.0, -2.0, -4.0]) / np.log(2.0), run.figures()
    for name in ("exponents_bits_per_s", "asymptotic_bits_per_s"):
        np.testing.assert_allclose(figures[name], bits, rtol=1e-8)
    assert figures["mean_trace_bits_per_s"] == pytest.approx(-7.0 / np.log(2.0), rel=1e-9)
    assert figures["lambda1_times_t_bits"] == pytest.approx(-2.0 / np.log(2.0), rel=1e-8)
    assert (figures["time_s"], figures["neutral_directions"]) == (2.0, 0)
    times, rates, traces = run.running()
    np.testing.assert_allclose(times, np.linspace(0.0, 2.0, 401)[1:], rtol=1e-12)
    np.testing.assert_allclose(rates, np.tile([-1.0, -2.0, -4.0], (400, 1)), rtol=1e-8)
    np.testing.assert_allclose(traces, -7.0, rtol=1e-9)
    last = [float(v) for v in run.estimates_csv().splitlines()[-1].split(",")]
    np.testing.assert_allclose(last, [2.0, *bits, -7.0 / np.log(2.0)], rtol=1e-8)


@pytest.mark.parametrize("goal", [0.02, 0.08])
def test_round_off_in_the_cancelled_jacobian_of_a_linearizing_loop_is_in_the_limits_errors(goal):
    # s^3 + 18 s^2 + 107 s + 210 = (s + 5)(s + 6)(s + 7), and the line of equilibria
    found = ballscrew.lyapunov("iol", reference=goal).motion
    off = np.abs(found.limit - [0.0, -5.0, -6.0, -7.0])
    assert np.all(off <= found.limit_error)
    assert found.limit_error.max() < 0.01


@pytest.mark.ci
@pytest.mark.parametrize("controller", ["iol", "nctf", "pid"])
def test_finite_time_exponents_are_within_their_bounds_of_a_far_finer_run(controller):
    found, finer = (
        loop_lyapunov(Loop(controller, stop=2.0), tolerance) for tolerance in (1e-8, 1e-13)
    )
    assert np.all(np.abs(found.exponents - finer.exponents) <= found.error)
    assert np.all(found.error < 1e-2 * np.maximum(1.0, np.abs(found.exponents)))


@pytest.mark.ci
@pytest.mark.parametrize("cell", [(66966.0, 355.76), (66967.331, 342.5), (66969.2, 350.0)])
def test_a_cell_of_a_map_and_a_single_loop_have_one_verdict(cell):
    """A creep that goes on, a cycle, and a loop that diverges."""
    loop = Loop("iol", stop=20.0)
    x = read_axis("sigma0_hat=66965.89:66969.24:2", loop)
    y = read_axis("sigma1_hat=340:366:2", loop)
    values = dict(zip(("sigma0_hat", "sigma1_hat"), cell, strict=True))
    single = loop_lyapunov(Loop("iol", stop=20.0, controller_values=values)).motion
    assert single.kind is run_cell(MapPlan(loop, x, y), *cell, 1e-6).verdict
