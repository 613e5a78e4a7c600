"""Verdicts and exponents of systems whose answers are in the literature, or exact."""

from __future__ import annotations

import math
from functools import cache

import known_systems as ks
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew import Component, Event, ForceBalance, ForceTerm, Loop, Mode, Output, State, symbol
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
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
RUNS = {  # what is known of the motion, how it is followed
    "stable focus": (Kind.FIXED_POINT, ks.linear, ks.entries(FOCUS), 50.0, 1e-10),
    "line of equilibria": (Kind.LINE, ks.linear, ks.entries(LINE), 20.0, 1e-10),
    "saddle": (Kind.DIVERGES, ks.linear, ks.entries(SADDLE), 50.0, 1e-10),
    # its orbits close, but there are many side by side: it is no cycle and no torus
    "centre": (Kind.UNDECIDED, ks.linear, ks.entries(CENTRE), 50.0, 1e-10),
    "Lorenz": (Kind.CHAOS, ks.lorenz, {}, 50.0, 1e-9),
    "Van der Pol": (Kind.CYCLE, ks.van_der_pol, {}, 60.0, 1e-10),
    "belt": (Kind.CYCLE, ks.belt, {}, 50.0, 1e-10),
    "dry friction": (Kind.CYCLE, ks.dry_friction, {}, 100.0, 1e-10),
    "relay": (Kind.CYCLE, ks.relay_loop, {}, 50.0, 1e-10),
    "ball on a table": (Kind.CYCLE, ks.bouncing_ball, {}, 50.0, 1e-10),
}


@cache
def run(name):
    _, make, values, stop, tolerance = RUNS[name]
    return lyapunov(ks.maker(make(), values), stop, tolerance, label=name)


@pytest.mark.parametrize("name", RUNS)
def test_the_verdict_is_the_known_one(name):
    motion = run(name).motion
    assert motion.kind is RUNS[name][0], motion.evidence


def test_what_a_belt_carries_is_not_at_rest_though_all_its_eigenvalues_are_zero():
    model = Model(ks.belt(), {}, 1e-10)
    model.advance(0.0, 40.0)
    assert model.mode == "stick"
    found = equilibrium_near(model, 40.0)
    assert found is not None
    assert found.neutral == 2
    assert found.drift == pytest.approx(ks.BELT_SPEED)


def test_lorenz_has_the_exponents_of_the_literature():
    """0.9056, 0, -14.5723: J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003; his page
    https://sprott.physics.wisc.edu/chaos/lorenzle.htm has 0.906, 0, -14.572 from a run of 10^6."""
    motion = run("Lorenz").motion
    assert np.all(motion.limit_error < 0.05)
    assert np.all(np.abs(motion.limit - [0.9056, 0.0, -14.5723]) < 4.0 * motion.limit_error)
    assert run("Lorenz").exponents.sum() == pytest.approx(-41.0 / 3.0, rel=1e-9)


def test_van_der_pols_cycle_has_the_exponents_and_the_period_of_another_solver():
    """The exponent that is not zero is the divergence's mean over a period."""

    def rhs(_, s):
        return [s[1], (1 - s[0] ** 2) * s[1] - s[0], 1 - s[0] ** 2]

    def upwards(_, s):
        return s[0]

    upwards.direction = 1
    options = {"rtol": 1e-12, "atol": 1e-12, "events": upwards}
    course = solve_ivp(rhs, (0.0, 200.0), [2.0, 0.0, 0.0], "DOP853", **options)
    times, sums = course.t_events[0][-2:], course.y_events[0][-2:, 2]
    period, motion = times[1] - times[0], run("Van der Pol").motion
    assert motion.period == pytest.approx(period, rel=1e-7)
    np.testing.assert_allclose(motion.limit, [0.0, np.diff(sums)[0] / period], atol=1e-6)


def test_a_belts_cycle_has_zero_and_minus_infinity_and_the_period_of_another_solver():
    def slipping(_, s):
        return [s[1], -s[0] + 1.0 / (1.0 + ks.FALLING * (ks.BELT_SPEED - s[1]))]

    def sticks(_, s):
        return s[1] - ks.BELT_SPEED

    sticks.terminal, sticks.direction = True, 1
    # just past the corner where both equations agree: x = 1 + tiny pulls it off the belt
    options = {"rtol": 1e-12, "atol": 1e-13, "events": sticks}
    begin = [1.0 + 1e-9, ks.BELT_SPEED - 1e-12]
    slip = solve_ivp(slipping, (0.0, 100.0), begin, "DOP853", **options)
    period = slip.t[-1] + (1.0 - slip.y[0, -1]) / ks.BELT_SPEED
    motion = run("belt").motion
    assert motion.period == pytest.approx(period, rel=1e-5)
    assert abs(motion.limit[0]) < 1e-6
    assert motion.limit[1] == -np.inf


def test_a_ball_that_loses_nothing_bounces_for_ever_and_on_no_cycle_of_its_own():
    """Its period grows with its energy, so a disturbance grows, too, but not exponentially."""
    model = ks.maker(ks.elastic_ball())(1e-9)
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
    run = lyapunov(ks.maker(ks.linear(), ks.entries(np.diag([-1.0, -2.0, -4.0]))), 2.0, 1e-10)
    bits, figures = np.array([-1.0, -2.0, -4.0]) / np.log(2.0), run.figures()
    for name in ("exponents_bits_per_s", "asymptotic_bits_per_s"):
        np.testing.assert_allclose(figures[name], bits, rtol=1e-8)
    assert figures["method"] == "one solver"
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
    assert np.all(np.abs(found.limit - [0.0, -5.0, -6.0, -7.0]) <= found.limit_error)
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
@pytest.mark.parametrize("cell", [(66966.0, 355.76), (66967.331, 342.5)])
def test_a_cell_of_a_map_and_a_single_loop_have_one_verdict(cell):
    """A creep that goes on, and a cycle."""
    loop = Loop("iol", stop=20.0)
    x = read_axis("sigma0_hat=66965.89:66969.24:2", loop)
    y = read_axis("sigma1_hat=340:366:2", loop)
    values = dict(zip(("sigma0_hat", "sigma1_hat"), cell, strict=True))
    single = loop_lyapunov(Loop("iol", stop=20.0, controller_values=values)).motion
    assert single.kind is run_cell(MapPlan(loop, x, y), *cell, 1e-6).verdict


# -- a cycle that is looked at where it turns ----------------------------------------------------


def pushed(damping):
    """A damped oscillator that is pushed in the direction in which it moves."""
    x, v = map(symbol, ("x", "v"))

    def mode(name, direction, other):
        return Mode(
            name,
            derivatives={"v": direction - x - damping * v},
            events=(Event("turns", v, direction=-direction, next_mode=other),),
        )

    return Component(
        name="pushed",
        description="an oscillator with a push",
        states=(
            State("x", "m", "position", v, start=1.0, nominal=10.0),  # the velocity is looked at
            State("v", "m/s", "velocity", 1 - x - damping * v, start=0.1),
        ),
        outputs=(Output("x", "m", "position", x), Output("v", "m/s", "velocity", v)),
        modes=(mode("forward", 1, "backward"), mode("backward", -1, "forward")),
    )


@pytest.mark.parametrize(
    "ratio", [0.15, *(pytest.param(r, marks=pytest.mark.ci) for r in (0.04, 0.5))]
)
def test_a_cycle_that_is_looked_at_where_it_turns(ratio):
    """There an axis of the states is the direction that shrinks, and stays it but for round-off.

    And a turn at either end of the periods that are looked at may be within them or not.
    """
    found = ballscrew.lyapunov("none", pushed(2.0 * ratio), stop=40.0 + 20.0 / ratio).motion
    assert found.kind.value == "limit cycle"
    assert found.limit == pytest.approx([0.0, -ratio], abs=1e-4 * ratio)
    assert found.period == pytest.approx(2.0 * math.pi / math.sqrt(1.0 - ratio**2), rel=1e-6)


# -- hunting of a mass with dry friction under PID, against an event-driven simulation -----------


KP, KI, KD = 20.0, 40.0, 6.0
FC, VS, SIGMA2 = 1.0, 0.05, 0.4
START = 1.0  # m


def loop(kp: float = KP, ki: float = KI, kd: float = KD) -> Component:
    """A mass of 1 kg at x, its set-point at 0, with its controller inside."""
    x, v, w = symbol("x"), symbol("v"), symbol("w")
    drive = ForceTerm("drive", -kp * x - kd * v - ki * w, "drive")
    return with_sticking(
        Component(
            name="body",
            description="A mass with dry friction under PID.",
            states=(
                State("x", "m", "position", v, START, 0.01),
                State("v", "m/s", "velocity", None, 0.0, 0.01),
                State("w", "m*s", "integral", x, 0.0, 0.01),
            ),
            balances=(ForceBalance("v", sp.Integer(1), (drive, classical(v))),),
            outputs=(Output("y", "m", "position", x),),
        )
    )


def simulated(static: float, stop: float) -> list[tuple[float, float]]:
    """Sticking and sliding in turn: time and position where each sticking begins."""
    t, x, w = 0.0, START, 0.0
    seen = []
    while t < stop:
        if abs(KP * x + KI * w) <= static:  # the integral grows until it breaks away
            seen.append((t, x))
            wait = (static * -np.sign(x) + KP * x + KI * w) / (-KI * x)
            t, w = t + wait, w + wait * x
        direction = -np.sign(KP * x + KI * w)

        def rates(_t: float, q: np.ndarray, direction=direction) -> list[float]:
            fall = direction * (FC + (static - FC) * np.exp(-((q[1] / VS) ** 2)))
            return [q[1], -KP * q[0] - KD * q[1] - KI * q[2] - fall - SIGMA2 * q[1], q[0]]

        def stops(_t: float, q: np.ndarray, direction=direction) -> float:
            return q[1] * direction

        stops.terminal, stops.direction = True, -1.0
        options = {"max_step": 0.1, "rtol": 1e-11, "atol": 1e-13, "events": stops}
        begin = [x, 1e-12 * direction, w]
        run = solve_ivp(rates, (t, t + 100.0), begin, "DOP853", **options)
        t, x, w = float(run.t[-1]), run.y[0, -1], run.y[2, -1]
    return seen


def test_period_and_amplitude_of_hunting_are_those_of_an_event_driven_solver() -> None:
    values = {"Fc": FC, "Fs": 2.0, "Vs": VS, "sigma2": SIGMA2}
    found = classify_attractor(Model(generate(loop()), values, 1e-9), 0.0, 40.0, exponents=False)
    assert found.kind is Kind.CYCLE, found.evidence
    turns = np.array(simulated(2.0, 120.0))[-8:]
    period = float(np.mean(turns[2:, 0] - turns[:-2, 0]))
    assert found.period == pytest.approx(period, rel=1e-6)
    assert found.amplitude["x"] == pytest.approx(float(np.mean(np.abs(turns[:, 1]))), rel=1e-6)
