"""Modes and events: located where exact solutions have them, and told apart from chatter."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
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
    relay = component(
        "relay",
        (State("x", "1", "integral of the level", sp.Integer(-1)),),
        (Mode("off", events=(on,)), Mode("on", derivatives={"x": sp.Integer(1)}, events=(off,))),
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
