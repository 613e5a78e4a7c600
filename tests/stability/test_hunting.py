"""Hunting of a mass with dry friction under PID, against an event-driven simulation of its own."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew.gallery.cart_pendulum.findings import BALANCE, DRY
from ballscrew.orchestration.loop import Loop
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    DiscreteState,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.held_states import with_held_states
from ballscrew.solver.kernel import Model
from ballscrew.stability.attractor import Attractor, Kind, classify_attractor
from ballscrew.stability.equilibria import equilibrium_near
from ballscrew.stability.loop_lyapunov import loop_maker

KP, KI, KD = 20.0, 40.0, 6.0
FC, VS, SIGMA2, PERIOD = 1.0, 0.05, 0.4, 0.01
START = 1.0  # m


def loop(sampled: bool, kp: float = KP, ki: float = KI, kd: float = KD) -> Component:
    """A mass of 1 kg at x, its set-point at 0, with its controller inside."""
    x, v, w = symbol("x"), symbol("v"), symbol("w")
    law = -kp * x - kd * v - ki * w
    drive = symbol("u") if sampled else law
    body = Component(
        name="body",
        description="A mass with dry friction under PID.",
        states=(
            State("x", "m", "position", v, START, 0.01),
            State("v", "m/s", "velocity", None, 0.0, 0.01),
            *(() if sampled else (State("w", "m*s", "integral", x, 0.0, 0.01),)),
        ),
        balances=(
            ForceBalance("v", sp.Integer(1), (ForceTerm("drive", drive, "drive"), classical(v))),
        ),
        discrete=(
            DiscreteState("u", "N", "force", law, nominal=1.0),
            DiscreteState("w", "m*s", "integral", w + PERIOD * x, nominal=0.01),
        )
        if sampled
        else (),
        outputs=(Output("y", "m", "position", x),),
        sample_time=Parameter("T", PERIOD, "s", "period", "test", minimum=1e-6)
        if sampled
        else None,
    )
    body = with_sticking(body)
    return with_held_states(body) if sampled else body


def becomes(component: Component, static: float, stop: float) -> Attractor:
    model = Model(generate(component), {"Fc": FC, "Fs": static, "Vs": VS, "sigma2": SIGMA2}, 1e-9)
    return classify_attractor(model, 0.0, stop, exponents=False)


def friction(v: float, direction: float, static: float) -> float:
    return direction * (FC + (static - FC) * np.exp(-((v / VS) ** 2))) + SIGMA2 * v


def simulated(static: float, sampled: bool, stop: float) -> list[tuple[float, float, float]]:
    """Sticking and sliding in turn: time, position and integral where each sticking begins."""
    t, x, v, w, u = 0.0, START, 0.0, 0.0, 0.0
    direction = 0.0
    seen = []
    while t < stop:
        end = stop
        if sampled:  # from sample to sample
            k = round(t / PERIOD)
            if abs(t - k * PERIOD) < 1e-12:
                u, w = -KP * x - KD * v - KI * w, w + PERIOD * x
                t = k * PERIOD
            end = (int(t / PERIOD + 1e-9) + 1) * PERIOD
        if direction == 0.0:
            held = u if sampled else -KP * x - KI * w
            if abs(held) > static:
                direction = np.sign(held)
                v = 1e-12 * direction
            elif sampled:
                t = end
                continue
            else:  # the integral grows until it breaks away
                wait = (static * -np.sign(x) + KP * x + KI * w) / (-KI * x)
                if t + wait >= stop:
                    break
                t, w = t + wait, w + wait * x
                direction = -np.sign(x)
                v = 1e-12 * direction

        def rates(_t: float, q: np.ndarray, direction=direction, u=u) -> list[float]:
            drive = u if sampled else -KP * q[0] - KD * q[1] - KI * q[2]
            return [q[1], drive - friction(q[1], direction, static), 0.0 if sampled else q[0]]

        def stops(_t: float, q: np.ndarray, direction=direction) -> float:
            return q[1] * direction

        stops.terminal, stops.direction = True, -1.0
        run = solve_ivp(
            rates, (t, end), [x, v, w], "DOP853", events=stops, max_step=0.1, rtol=1e-11, atol=1e-13
        )
        t = float(run.t[-1])
        x, v, w = run.y[:, -1]
        if run.status == 1:
            held = u if sampled else -KP * x - KI * w
            v, direction = 0.0, 0.0
            if abs(held) <= static:
                seen.append((t, x, w))
    return seen


@pytest.mark.parametrize("sampled", [False, True])
def test_period_and_amplitude_of_hunting_are_those_of_an_event_driven_solver(sampled: bool) -> None:
    found = becomes(loop(sampled), 2.0, 40.0)
    assert found.kind is Kind.CYCLE, found.evidence
    rests = np.array(simulated(2.0, sampled, 120.0))
    turns = rests[-8:]
    period = float(np.mean(turns[2:, 0] - turns[:-2, 0]))
    amplitude = float(np.mean(np.abs(turns[:, 1])))
    assert found.period is not None
    turns_of_one = round(found.period / period)  # at sample instants it may close after several
    assert 1 <= turns_of_one <= (4 if sampled else 1)
    assert found.period / turns_of_one == pytest.approx(period, rel=1e-4 if sampled else 1e-6)
    assert found.amplitude["x"] == pytest.approx(amplitude, rel=1e-2 if sampled else 1e-6)


def test_a_block_that_hunts_is_nowhere_at_rest_however_near_it_passes_to_an_equilibrium() -> None:
    """Of these phases, some were an isolated fixed point of sliding, others a line of sticking."""
    gains = {"kp": 42.0, "ki": 185.0, "kd": 11.6}
    values = {"Fc": 1.0, "Fs": 1.375, "Vs": 0.013, "sigma2": 0.0}
    model = Model(generate(loop(False, **gains)), values, 1e-9)
    time = 91.0
    model.advance(0.0, time)
    for _ in range(30):
        model.advance(time, time + 0.1)
        time += 0.1
        kept = model.x.copy(), model.u.copy()
        found = classify_attractor(model, time, 90.0, exponents=False, rounds=1)
        assert found.kind is Kind.CYCLE, found.evidence
        model.x[:], model.u[:] = kept


def test_without_a_fall_from_static_to_sliding_friction_the_error_shrinks_without_hunting() -> None:
    """A. Bisoffi et al., IEEE Transactions on Automatic Control 63, 2654 (2018)."""
    found = becomes(loop(False), FC, 40.0)
    assert found.kind is not Kind.CYCLE
    errors = np.abs(np.array(simulated(FC, False, 400.0))[:, 1])
    assert (np.diff(errors[2:]) <= 1e-12).all()
    assert errors[-1] < 0.2 * errors[2]


@pytest.mark.parametrize(("static", "integral"), [(40.0, 3000.0), (10.0, 3000.0)])
def test_a_block_that_sticks_while_its_integral_fills_is_not_at_rest(
    static: float, integral: float
) -> None:
    given = {"Fc": 1.0, "Fs": static, "Vs": 1e-3}
    loop = Loop("pid", "plant_classical", plant_values=given, controller_values={"Ki": integral})
    model = loop_maker(loop)(1e-7)
    found = classify_attractor(model, 0.0, 60.0, exponents=False, rounds=3)
    assert found.kind is Kind.CYCLE, found.evidence


def test_a_sampled_integral_that_fills_is_a_drift() -> None:
    """A block that sticks a millimetre from its goal: the integral, and the current, go on."""
    given = {"Fc": 5.0, "Fs": 25.0}
    gains = {"Ki": 100.0, "Kp": 1.0, "Kd": 0.0}
    loop = Loop("pid_sampled", "plant_classical", plant_values=given, controller_values=gains)
    model = loop_maker(loop)(1e-8)
    names = [s.name for s in model.kernel.states]
    model.x[names.index("plant_x")] = model.x[names.index("controller_x_last")] = 0.081
    found = equilibrium_near(model, 0.0)
    assert found is not None
    resistance = model.p[[p.name for p in model.kernel.parameters].index("plant_R")]
    current = 100.0 * 1e-3 / resistance  # A/s, the fastest of all over its nominal value
    nominal = model.kernel.nominal[names.index("plant_i")]
    assert found.drift == pytest.approx(current / nominal, rel=1e-6)


def test_wherever_in_its_cycle_it_is_looked_at_a_hunting_cart_is_not_at_rest() -> None:
    """It slides towards a place where it would rest if it came there; but it sticks before."""
    make = loop_maker(Loop(BALANCE, DRY, reference=0.0))
    model = make(1e-9)
    model.advance(0.0, 30.0)
    state, mode = model.x.copy(), model.u.copy()
    for k in range(40):
        time = 30.0 + 0.1 * k  # half a period
        model.x[:], model.u[:] = state, mode
        model.advance(30.0, time)
        found = classify_attractor(model, time, 10.0, exponents=False, rounds=1)
        assert found.kind is Kind.CYCLE, found.evidence
