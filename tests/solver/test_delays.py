"""Delayed signals against the method of steps, on both roads: the core, and plain Python."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew.solver import core, stepper
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    ContractError,
    Delay,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.connect import connect
from ballscrew.solver.kernel import IntegrationError, Model
from ballscrew.solver.tape import UnsupportedComponent

X, LATE, TAU = map(symbol, ("x", "late", "tau"))


@pytest.fixture(params=["core", "plain"])
def road(request):
    return request.param


def model_of(component, road="core", tolerance=1e-9, **values):
    kernel = generate(component)
    model = Model(kernel, values, tolerance)
    if road == "plain":
        space = {}
        exec(kernel.source, space)
        states, events = len(kernel.states), kernel.events
        model.system = stepper.PlainSystem(SimpleNamespace(**space), states, events)
    return model


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
def test_a_linear_delay_follows_the_method_of_steps(road, gain, tau):
    times = np.linspace(0.0, 10.0 * tau, 32)
    model = model_of(scalar(-gain * LATE, tau), road, 1e-11)
    expected = [decay_by_steps(t, gain, tau) for t in times]
    assert followed(model, times)[:, 0] == pytest.approx(expected, abs=1e-11)


def by_hand(rate, tau, x0, intervals):
    """The course over the last of so many intervals: one smooth equation for each before it."""
    starts = [x0]
    for count in range(1, intervals + 1):

        def rates(s, y, count=count):
            before = [x0, *y]
            return [rate(before[k + 1], before[k]) for k in range(count)]

        done = solve_ivp(
            rates,
            (0.0, tau),
            starts,
            method="DOP853",
            rtol=3e-14,
            atol=1e-15,
        )
        starts.append(done.y[-1, -1])
    return starts[-1]


WRIGHT = -1.2 * LATE * (1 + X)  # its solution swings and is no polynomial


@pytest.mark.parametrize("share", [1.0, 0.73])  # steps that the delay is a multiple of, or not
def test_the_order_is_five(road, share):
    exact = by_hand(lambda x, late: -1.2 * late * (1 + x), 1.0, 0.8, 4)
    counts, errors = np.array([8, 16, 32]), []
    for count in counts:
        model = model_of(scalar(WRIGHT, start=0.8), road, 1e30)
        steps = np.arange(0.0, 4.0, 4.0 * share / (4 * count))
        followed(model, [*steps[4.0 - steps > 1e-9], 4.0])
        errors.append(abs(model.x[0] - exact))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 4.6 < order < 6.0, errors


def test_a_delay_shorter_than_a_step_shortens_the_steps(road):
    """x' = -x(t - tau) is almost x' = -x: without a delay, few steps would be enough."""
    tau = 0.01
    model = model_of(scalar(-LATE, tau), road, 1e-6)
    model.advance(0.0, 1.0)
    assert model.info[core.ACCEPTED] >= 1.0 / tau
    assert model.x[0] == pytest.approx(decay_by_steps(1.0, 1.0, tau), abs=1e-12)


def test_the_error_follows_the_tolerance():
    exact = by_hand(lambda x, late: -1.2 * late * (1 + x), 1.0, 0.8, 8)
    for tolerance in (1e-5, 1e-7, 1e-9, 1e-11):
        model = model_of(scalar(WRIGHT, start=0.8), tolerance=tolerance)
        model.advance(0.0, 8.0)
        assert abs(model.x[0] - exact) < 30 * tolerance


def test_steps_end_where_a_jump_arrives(road):
    """At multiples of the delay derivatives of ever higher order jump; not beyond the sixth."""
    model = model_of(scalar(-LATE, 0.7), road, 1e-3)
    model.advance(0.0, 6.0)
    history = model.system.history
    first = core.DURATIONS + 1 + len(model.u)
    rows = history[first:].reshape(-1, core.step_size(1))[: int(history[core.COUNT])]
    begins = {round(t, 12): level for t, level in rows[:, :2]}
    assert [begins.get(round(0.7 * k, 12)) for k in range(6)] == [1, 2, 3, 4, 5, 6]


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


def test_a_jump_of_an_input_arrives_at_its_instant(road):
    model = model_of(dead_time(), road)
    jumps = np.array([0.0, 0.1, 0.33, 0.6, 0.61, 1.2])
    grid = np.unique(np.round([*jumps, *(jumps + 0.35), *np.linspace(0.0, 2.0, 21)], 9))
    for t0, t1 in pairwise(grid):
        model.set_input("u", float(np.sum(jumps <= t0)))
        model.advance(t0, t1)
        arrived = np.sum(jumps <= t1 - 0.35 + 1e-12)
        expected = float(arrived) if t1 >= 0.35 - 1e-12 else -1.0
        assert model.outputs(t1, model.x)["y"] == pytest.approx(expected, abs=1e-12)


def test_a_delayed_jump_is_integrated_without_error(road):
    """Both sides of the jump, though no call ends there."""
    sum_of = State("x", "V*s", "integral", LATE)
    model = model_of(dead_time(states=(sum_of,)), road, 1e-6)
    model.set_input("u", 2.0)
    model.advance(0.0, 0.2)
    model.set_input("u", 5.0)
    model.advance(0.2, 2.0)
    assert model.x[0] == pytest.approx(-0.35 + 2.0 * 0.2 + 5.0 * (2.0 - 0.55), rel=1e-13)
    assert model.info[core.REJECTED] == 0


def test_a_delayed_function_of_time_is_followed_as_the_tolerance_asks(road):
    for tolerance in (1e-5, 1e-8):
        model = model_of(dead_time(sp.sin(40 * TIME)), road, tolerance)
        times = np.linspace(0.0, 1.5, 61)
        for t0, t1 in pairwise(times):
            model.advance(t0, t1)
            expected = math.sin(40 * (t1 - 0.35)) if t1 > 0.35 else -1.0
            assert abs(model.outputs(t1, model.x)["y"] - expected) < 5 * tolerance


def test_delays_of_delays_add_up(road):
    u, later = symbol("u"), symbol("later")
    component = Component(
        "chain",
        "two delays in a row, and one that hears itself",
        parameters=(Parameter("tau", 0.35, "s", "delay", "made up"),),
        inputs=(Input("u", "V", "command"),),
        outputs=(
            Output("y", "V", "delayed twice", later),
            Output("echo", "V", "its own echo", symbol("echo_late")),
        ),
        delays=(
            Delay("late", u, TAU),
            Delay("later", LATE, 2 * TAU),
            Delay("echo_late", u - symbol("echo_late") / 2, sp.Float(0.25)),
        ),
    )
    model = model_of(component, road)
    model.set_input("u", 4.0)
    seen = {}
    for k in range(32):
        seen[k + 1] = None
        model.advance(0.1 * k, 0.1 * (k + 1))
        seen[k + 1] = model.outputs(0.1 * (k + 1), model.x)
    assert [seen[k]["y"] for k in (1, 10, 11, 30)] == [0.0, 0.0, 4.0, 4.0]
    # 4 after the first quarter, then 4 - 4/2, 4 - 2/2, ...
    assert [seen[k]["echo"] for k in (1, 3, 6, 8, 11)] == [0.0, 4.0, 2.0, 3.0, 2.5]


def relay(road):
    """x' = +-1, switched by x as it was 0.3 s ago: a swing of amplitude 0.3 about +-0.1."""
    up = Event("up", LATE + 0.1, -1, next_mode="rising")
    down = Event("down", LATE - 0.1, 1, next_mode="falling")
    rising = Mode("rising", {"x": sp.Integer(1)}, events=(down,))
    falling = Mode("falling", {"x": sp.Integer(-1)}, events=(up,))
    return model_of(scalar(sp.Integer(1), 0.3, start=0.0, modes=(rising, falling)), road, 1e-6)


def test_a_delayed_signal_makes_an_event_happen(road):
    model = relay(road)
    # x(0.1) = 0.1 is heard at 0.4, when x is 0.4; from there down to -0.4, and so on
    expected = {0.4: 0.4, 0.9: -0.1, 1.2: -0.4, 1.6: 0.0, 2.0: 0.4, 3.6: 0.4}
    t0 = 0.0
    for t, x in expected.items():
        model.advance(t0, t)
        assert model.x[0] == pytest.approx(x, abs=1e-12)
        t0 = t
    assert model.info[core.EVENTS] in (4, 5)


@pytest.mark.parametrize(
    "make",
    [
        lambda road: model_of(scalar(WRIGHT, start=0.8), road, 1e-7),
        lambda road: model_of(scalar(-20 * LATE - sp.sin(X), 0.02), road, 1e-5),
        relay,
    ],
)
def test_both_roads_give_the_same_numbers(make):
    one, other = make("core"), make("plain")
    for t0, t1 in ((0.0, 0.013), (0.013, 0.7), (0.7, 2.0)):
        one.advance(t0, t1)
        other.advance(t0, t1)
        assert np.array_equal(one.x, other.x)
        assert np.array_equal(one.info, other.info)
        assert np.array_equal(one.outputs(t1, one.x)["late"], one.outputs(t1, other.x)["late"])
    count = int(one.system.history[core.COUNT])
    used = core.DURATIONS + 1 + len(one.u) + count * core.step_size(1)
    both = [m.system.history[1:used] for m in (one, other)]
    assert np.array_equal(*both)


def test_compiled_equations_give_the_same_numbers(tmp_path, monkeypatch):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path))
    kernel = generate(scalar(WRIGHT, start=0.8))
    before = Model(kernel)
    before.advance(0.0, 5.0)
    kernel.compile()
    assert list((tmp_path / "equations").iterdir())
    after = Model(kernel)
    after.advance(0.0, 5.0)
    assert np.array_equal(before.x, after.x)


def test_a_history_that_is_put_back_goes_on_as_before(road):
    model = model_of(scalar(WRIGHT, start=0.8), road, 1e-7)
    model.advance(0.0, 2.3)
    kept = model.x.copy(), model.info.copy(), model.system.history.copy()
    model.advance(2.3, 4.0)
    end = model.x.copy()
    model.x[:], model.info[:] = kept[:2]
    model.system.remember(kept[2])
    model.advance(2.3, 4.0)
    assert np.array_equal(model.x, end)


def test_a_run_that_begins_again_has_forgotten(road):
    model = model_of(scalar(-LATE), road)
    model.advance(0.0, 3.0)
    model.x[:] = 1.0
    model.info[:] = 0.0
    model.advance(0.0, 2.0)
    assert model.x[0] == pytest.approx(decay_by_steps(2.0, 1.0, 1.0), abs=1e-9)


def test_a_long_history_finds_room(road):
    model = model_of(scalar(-LATE), road)
    times = np.linspace(0.0, 2.0, 1001)
    followed(model, times)
    assert model.x[0] == pytest.approx(decay_by_steps(2.0, 1.0, 1.0), abs=1e-12)
    assert 512 <= model.system.history[core.ROOM] <= 1024


def test_simulate_and_advance_are_the_same():
    one, other = (model_of(scalar(WRIGHT, start=0.8)) for _ in range(2))
    times = np.linspace(0.0, 3.0, 13)
    course = one.simulate(times)
    assert np.array_equal(course.states["x"], followed(other, times)[:, 0])
    assert course.outputs["late"][:5] == pytest.approx(0.8)


def test_the_partial_derivative_by_time_knows_the_delayed_signal():
    model = model_of(scalar(-3 * LATE * X))
    model.advance(0.0, 1.6)
    by_time, matrix, step = np.empty(1), np.empty((1, 1)), 1e-5
    model.system.jac(1.6, model.x, model.u, model.p, matrix, by_time)
    rates = [model.derivatives(1.6 + s, model.x)[0] for s in (-step, step)]
    assert by_time[0] == pytest.approx((rates[1] - rates[0]) / (2 * step), rel=1e-6)


def test_a_loop_keeps_its_delays():
    """An integrator that hears its command late, under a gain that sees it late, too."""
    u, gain = symbol("u"), symbol("gain")
    plant = Component(
        "plant",
        "integrator",
        parameters=(Parameter("tau", 0.7, "s", "delay", "made up"),),
        inputs=(Input("u", "1", "command", law=("x",)),),
        states=(State("x", "1", "x", symbol("heard"), start=1.0),),
        outputs=(Output("x", "1", "x", X),),
        delays=(Delay("heard", u, TAU, start=-0.5),),
    )
    controller = Component(
        "gain",
        "gain on a late measurement",
        parameters=(
            Parameter("gain", 0.5, "1", "gain", "made up"),
            Parameter("tau", 0.3, "s", "delay", "made up"),
        ),
        inputs=(Input("x", "1", "x", role="measurement"),),
        outputs=(Output("u", "1", "command", -gain * symbol("seen")),),
        delays=(Delay("seen", X, TAU, start=1.0),),
    )
    loop = connect(plant, controller)
    assert [d.name for d in loop.delays] == ["plant_heard", "controller_seen"]
    model = model_of(loop, tolerance=1e-11)
    model.advance(0.0, 5.0)
    # both delays in a row are one of 1 s; before that the command was -0.5
    assert model.x[0] == pytest.approx(decay_by_steps(5.0, 0.5, 1.0), abs=1e-10)


def test_a_delay_of_a_signal_that_modes_change_is_refused():
    on = Mode("on", outputs={"x": 2 * X})
    moded = Component(
        "moded",
        "an output per mode",
        inputs=(Input("u", "1", "command"),),
        states=(State("x", "1", "x", symbol("u")),),
        outputs=(Output("x", "1", "x", X),),
        modes=(on,),
    )
    controller = Component(
        "late",
        "late",
        inputs=(Input("x", "1", "x", role="measurement"),),
        outputs=(Output("u", "1", "command", -LATE),),
        delays=(Delay("late", X, sp.Integer(1)),),
    )
    with pytest.raises(
        ContractError, match="'controller_late' delays a signal that depends on the mode"
    ):
        connect(moded, controller)


def test_a_duration_that_moves_is_refused():
    with pytest.raises(UnsupportedComponent, match=r"^scalar: the duration .* depends on 'x'"):
        generate(
            Component(
                "scalar",
                "one state",
                states=(State("x", "1", "x", -LATE),),
                delays=(Delay("late", X, 1 + X**2),),
            )
        )


@pytest.mark.parametrize("tau", [0.0, -1.0, math.inf, math.nan])
def test_a_delay_that_lasts_no_time_is_refused(road, tau):
    model = model_of(scalar(-LATE), road)
    model.p[0] = tau
    with pytest.raises(IntegrationError, match=r"^scalar: a delay is not a positive number of"):
        model.advance(0.0, 1.0)
