"""Modes, events and delays: located and followed where exact solutions have them."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew import TIME, Component, Delay, Event, Input, Mode, Output, Parameter, State, symbol
from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import IntegrationError, Model
from ballscrew.solver.spectrum import follow_returns

x, v, u = symbol("x"), symbol("v"), symbol("u")


def component(name, states, modes, outputs=(), inputs=(), parameters=()):
    return Component(
        name,
        "a system for tests",
        states=states,
        outputs=outputs or tuple(Output(s.name, s.unit, "state", symbol(s.name)) for s in states),
        inputs=inputs,
        parameters=parameters,
        modes=modes,
    )


def rotating(events, modes=None):
    """x = sin t, v = cos t."""
    states = (State("x", "1", "sine", v), State("v", "1", "cosine", -x, start=1.0))
    return component("rotating", states, modes or (Mode("only", events=events),))


def bouncing(restitution=0.8, gravity=9.81):
    impact = Event("impact", x, direction=-1, reset={"v": -restitution * v})
    states = (
        State("x", "m", "height", v, start=1.0),
        State("v", "m/s", "speed", -sp.Float(gravity)),
    )
    return component("bouncing", states, (Mode("flight", events=(impact,)),))


def exact_height(t, restitution=0.8, gravity=9.81, start=1.0):
    landing = np.sqrt(2 * start / gravity)
    if t < landing:
        return start - gravity * t**2 / 2
    speed = gravity * landing * restitution
    while t >= landing + 2 * speed / gravity:
        landing += 2 * speed / gravity
        speed *= restitution
    return speed * (t - landing) - gravity * (t - landing) ** 2 / 2


def test_a_bouncing_mass_follows_its_exact_course_to_round_off():
    times = np.linspace(0, 3, 301)
    course = Model(generate(bouncing()), tolerance=1e-9).simulate(times)
    exact = [exact_height(t) for t in times]
    np.testing.assert_allclose(course.outputs["x"], exact, atol=1e-12)
    assert course.events == 6


@pytest.mark.parametrize("with_a_mode", [False, True])
def test_bounces_without_end_stop_with_the_time_and_not_with_a_hang(with_a_mode):
    """They accumulate at sqrt(2/g) (1 + 2 e/(1 - e)) = 0.7526 s for e = 1/4."""
    ball = bouncing_through_a_mode() if with_a_mode else bouncing(restitution=0.25)
    model = Model(generate(ball))
    with pytest.raises(IntegrationError, match=r"events follow each other .* t = 0\.7525\d+ s"):
        model.advance(0.0, 1.0)
    assert model.info[core.EVENTS] < 400


def bouncing_through_a_mode():
    hits = Event("hits", x, direction=-1, reset={"x": sp.Integer(0)}, next_mode="impact")
    leaves = Event("leaves", -v, direction=1, reset={"v": -v / 4}, next_mode="flight")
    modes = (Mode("flight", events=(hits,)), Mode("impact", events=(leaves,)))
    return component("bouncing_through_a_mode", bouncing().states, modes)


def test_returns_that_could_not_be_followed_to_the_end_say_so():
    model = Model(generate(bouncing(restitution=0.25)))
    passes = follow_returns(model, 0.0, 1.0, 0, np.inf, 1)
    assert "events follow each other without end" in passes.failure
    assert passes.end == pytest.approx(0.7526, abs=1e-4)


def counting(direction):
    """sin t - 1/2 crosses upwards at pi/6, downwards at 5 pi/6, and so on; modes count."""
    event = Event("e", x - sp.Rational(1, 2), direction=direction)
    modes = [
        Mode(
            str(k),
            outputs={"passed": sp.Integer(k)},
            events=(replace(event, next_mode=str(k + 1)),) if k < 6 else (),
        )
        for k in range(7)
    ]
    states = (State("x", "1", "sine", v), State("v", "1", "cosine", -x, start=1.0))
    passed = Output("passed", "1", "number of crossings", sp.Integer(0))
    return component("counting", states, tuple(modes), (passed,))


def test_an_event_of_either_direction_is_every_change_of_sign():
    model = Model(generate(counting(0)), tolerance=1e-10)
    ends = np.array([0.0, 0.9, 1.1, 5.1, 8.0, 12.0]) * np.pi / 6
    assert model.simulate(ends).outputs["passed"].tolist() == [0, 0, 1, 2, 2, 2]
    model = Model(generate(counting(0)), tolerance=1e-10)
    assert model.simulate([0.0, 4 * np.pi - 0.1]).outputs["passed"][-1] == 4


def test_an_event_with_a_direction_is_due_where_its_indicator_is_past_zero():
    """Downwards, sin 0 - 1/2 is past zero at the start already: through all modes at once."""
    model = Model(generate(counting(-1)), tolerance=1e-10)
    model.settle(0.0)
    assert model.mode == "6"
    upwards = Model(generate(counting(1)), tolerance=1e-10)
    upwards.settle(0.0)
    assert upwards.mode == "0"


def test_the_time_of_an_event_converges_with_the_tolerance_to_the_exact_one():
    """v is multiplied by two where sin t reaches 1/2; after it x = 1/2 cos s + sqrt(3) sin s."""
    double = Event("double", x - sp.Rational(1, 2), direction=1, reset={"v": 2 * v}, next_mode="b")
    kernel = generate(rotating((), (Mode("a", events=(double,)), Mode("b"))))
    s = 1.0 - np.pi / 6
    exact = 0.5 * np.cos(s) + np.sqrt(3) * np.sin(s)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        model = Model(kernel, tolerance=tolerance)
        model.advance(0.0, 1.0)
        assert model.mode == "b"
        errors.append(abs(model.x[0] - exact))
    assert all(e < 10 * t for e, t in zip(errors, (1e-4, 1e-6, 1e-8, 1e-10), strict=True))
    assert errors[-1] < 1e-4 * errors[0]


def test_a_crossing_that_comes_and_goes_within_a_step_is_seen():
    """0.999 is passed by sin t for 0.09 s; the solver's own steps are longer than that."""
    seen = Event("peak", x - sp.Float(0.999), direction=1, next_mode="seen")
    kernel = generate(rotating((), (Mode("before", events=(seen,)), Mode("seen"))))
    model = Model(kernel, tolerance=1e-3)
    model.advance(0.0, 3.0)
    assert model.mode == "seen"


@pytest.mark.ci
def test_a_crossing_is_seen_though_another_one_was_looked_for_in_vain():
    """x = t^4 goes in one step; its cubic dips below zero at a quarter, the motion does not."""
    dips = Event("dips", -x - sp.Rational(1, 100), direction=1, next_mode="dipped")
    near = sp.Rational(1, 100) - (x - sp.Rational(3, 100)) ** 2 - (TIME - sp.Rational(1, 2)) ** 2
    passes = Event("passes", near, direction=1, next_mode="passed")
    modes = (Mode("before", events=(dips, passes)), Mode("dipped"), Mode("passed"))
    states = (State("x", "1", "fourth power of time", 4 * TIME**3),)
    model = Model(generate(component("fourth_power", states, modes)), tolerance=1e-3)
    model.advance(0.0, 1.0)
    assert model.mode == "passed"


def test_an_event_that_is_due_after_an_input_jumps_happens_at_once():
    on = Event("on", u - 1, direction=1, next_mode="on")
    off = Event("off", u + 1, direction=-1, next_mode="off")
    back = Event("back", u - 2, 1, {"x": sp.Integer(5)})
    relay = component(
        "relay",
        (State("x", "1", "integral of the level", sp.Integer(-1)),),
        (
            Mode("off", events=(on, back)),
            Mode("on", derivatives={"x": sp.Integer(1)}, events=(off, back)),
        ),
        inputs=(Input("u", "1", "signal"),),
    )
    model = Model(generate(relay))
    t = 0.0
    for signal, mode in ((0.9, "off"), (1.1, "on"), (-0.9, "on"), (-1.1, "off"), (0.0, "off")):
        model.set_input("u", signal)
        model.advance(t, t + 1.0)
        t += 1.0
        assert model.mode == mode
    assert model.x[0] == pytest.approx(-1 + 1 + 1 - 1 - 1, abs=1e-12)
    model.set_input("u", 3.0)
    model.advance(t, t + 1.0)
    assert model.x[0] == pytest.approx(5 + 1, abs=1e-12)


def test_a_state_that_a_mode_holds_is_held_to_the_last_bit():
    """Whatever the others do: held states take no part in the elimination's round-off."""
    rate = Parameter("rate", 1e7, "1/s", "of the other states", "example value")
    states = (
        State("x", "1", "held", v, start=0.1),
        State("v", "1", "held", -symbol("w"), start=0.3),
        State("w", "1", "moves", symbol("rate") * (v - symbol("w")) + sp.sin(100 * TIME)),
    )
    held = Mode("held", derivatives={"x": sp.Integer(0), "v": sp.Integer(0)})
    model = Model(generate(component("holding", states, (held,), parameters=(rate,))))
    model.simulate(np.linspace(0, 1, 1001))
    assert model.x[:2].tolist() == [0.1, 0.3]


# -- delays, by the method of steps --------------------------------------------------------------


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
    model = model_of(dead_time(states=(State("x", "V*s", "integral", LATE),)), 1e-6)
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
