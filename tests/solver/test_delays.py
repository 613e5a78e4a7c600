"""Delayed signals against the method of steps."""

import math
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Delay,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import IntegrationError, Model

X, LATE, TAU = map(symbol, ("x", "late", "tau"))


def model_of(component, tolerance=1e-9, **values):
    return Model(generate(component), values, tolerance)


def scalar(rate, tau=1.0, start=1.0, **more):
    """x' = rate, in which `late` is x as it was tau ago, and `start` before."""
    return Component(
        "scalar",
        "one state with a delay",
        parameters=(Parameter("tau", tau, "s", "delay", "made up", minimum=0.0),),
        states=(State("x", "1", "x", rate, start=start),),
        outputs=(Output("x", "1", "x", X), Output("late", "1", "x before", LATE)),
        delays=(Delay("late", X, TAU, start=start),),
        **more,
    )


def decay_by_steps(t, gain, tau):
    """x' = -gain x(t - tau), x = 1 before: a polynomial more in every interval."""
    return math.fsum(
        (-gain * (t - (k - 1) * tau)) ** k / math.factorial(k) for k in range(int(t / tau) + 2)
    )


def followed(model, times):
    states = [model.x.copy()]
    for t0, t1 in pairwise(times):
        model.advance(t0, t1)
        states.append(model.x.copy())
    return np.array(states)


@pytest.mark.parametrize(("gain", "tau"), [(1.0, 1.0), (0.3, 2.5), (6.0, 0.03)])
def test_a_linear_delay_follows_the_method_of_steps(gain, tau):
    times = np.linspace(0.0, 10.0 * tau, 32)
    model = model_of(scalar(-gain * LATE, tau), 1e-11)
    expected = [decay_by_steps(t, gain, tau) for t in times]
    assert followed(model, times)[:, 0] == pytest.approx(expected, abs=1e-11)


def by_hand(rate, tau, x0, intervals):
    """The course over the last of so many intervals: one smooth equation for each before it."""
    starts = [x0]
    for count in range(1, intervals + 1):

        def rates(s, y, count=count):
            before = [x0, *y]
            return [rate(before[k + 1], before[k]) for k in range(count)]

        done = solve_ivp(rates, (0.0, tau), starts, method="DOP853", rtol=3e-14, atol=1e-15)
        starts.append(done.y[-1, -1])
    return starts[-1]


WRIGHT = -1.2 * LATE * (1 + X)  # its solution swings and is no polynomial


@pytest.mark.parametrize("share", [1.0, 0.73])  # steps that the delay is a multiple of, or not
def test_the_order_is_five(share):
    exact = by_hand(lambda x, late: -1.2 * late * (1 + x), 1.0, 0.8, 4)
    counts, errors = np.array([8, 16, 32]), []
    for count in counts:
        model = model_of(scalar(WRIGHT, start=0.8), 1e30)
        steps = np.arange(0.0, 4.0, 4.0 * share / (4 * count))
        followed(model, [*steps[4.0 - steps > 1e-9], 4.0])
        errors.append(abs(model.x[0] - exact))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 4.6 < order < 6.0, errors


def test_a_delay_shorter_than_a_step_shortens_the_steps():
    """x' = -x(t - tau) is almost x' = -x: without a delay, few steps would be enough."""
    tau = 0.01
    model = model_of(scalar(-LATE, tau), 1e-6)
    model.advance(0.0, 1.0)
    assert model.info[core.ACCEPTED] >= 1.0 / tau
    assert model.x[0] == pytest.approx(decay_by_steps(1.0, 1.0, tau), abs=1e-12)


def dead_time(expression=None, **more):
    u = symbol("u")
    return Component(
        "dead_time",
        "passes a signal on later",
        parameters=(Parameter("tau", 0.35, "s", "delay", "made up"),),
        inputs=(Input("u", "V", "command"),),
        outputs=(Output("y", "V", "delayed", LATE),),
        delays=(Delay("late", u if expression is None else expression, TAU, start=-1.0),),
        **more,
    )


def test_a_delayed_jump_is_integrated_without_error():
    """Both sides of the jump, though no call ends there."""
    sum_of = State("x", "V*s", "integral", LATE)
    model = model_of(dead_time(states=(sum_of,)), 1e-6)
    model.set_input("u", 2.0)
    model.advance(0.0, 0.2)
    model.set_input("u", 5.0)
    model.advance(0.2, 2.0)
    assert model.x[0] == pytest.approx(-0.35 + 2.0 * 0.2 + 5.0 * (2.0 - 0.55), rel=1e-13)
    assert model.info[core.REJECTED] == 0


def test_a_delayed_function_of_time_is_followed_as_the_tolerance_asks():
    for tolerance in (1e-5, 1e-8):
        model = model_of(dead_time(sp.sin(40 * TIME)), tolerance)
        times = np.linspace(0.0, 1.5, 61)
        for t0, t1 in pairwise(times):
            model.advance(t0, t1)
            expected = math.sin(40 * (t1 - 0.35)) if t1 > 0.35 else -1.0
            assert abs(model.outputs(t1, model.x)["y"] - expected) < 5 * tolerance


def relay():
    """x' = +-1, switched by x as it was 0.3 s ago: a swing of amplitude 0.3 about +-0.1."""
    up = Event("up", LATE + 0.1, -1, next_mode="rising")
    down = Event("down", LATE - 0.1, 1, next_mode="falling")
    rising = Mode("rising", {"x": sp.Integer(1)}, events=(down,))
    falling = Mode("falling", {"x": sp.Integer(-1)}, events=(up,))
    return model_of(scalar(sp.Integer(1), 0.3, start=0.0, modes=(rising, falling)), 1e-6)


def test_a_delayed_signal_makes_an_event_happen():
    model = relay()
    # x(0.1) = 0.1 is heard at 0.4, when x is 0.4; from there down to -0.4, and so on
    expected = {0.4: 0.4, 0.9: -0.1, 1.2: -0.4, 1.6: 0.0, 2.0: 0.4, 3.6: 0.4}
    t0 = 0.0
    for t, x in expected.items():
        model.advance(t0, t)
        assert model.x[0] == pytest.approx(x, abs=1e-12)
        t0 = t
    assert model.info[core.EVENTS] in (4, 5)


def test_a_duration_that_moves_is_refused():
    with pytest.raises(ContractError, match=r"^scalar: the duration .* depends on 'x'"):
        generate(
            Component(
                "scalar",
                "one state",
                states=(State("x", "1", "x", -LATE),),
                delays=(Delay("late", X, 1 + X**2),),
            )
        )


def test_a_delay_that_lasts_no_time_is_refused():
    model = model_of(scalar(-LATE))
    for tau in (0.0, -1.0, math.inf, math.nan):
        model.p[0] = tau
        with pytest.raises(IntegrationError, match=r"^scalar: a delay is not a positive number of"):
            model.advance(0.0, 1.0)
