"""Components with modes, events and delays as FMUs, under hosts of both kinds of simulation."""

import fmpy
import numpy as np
import pytest
import sympy as sp
from any_fmu import KINDS, Host
from exchange_courses import COMPONENTS, cases, complaint, outcome
from exchange_host import ExchangeHost
from fmpy.validation import validate_fmu

from ballscrew import TIME, Component, Delay, Event, Input, Mode, Output, Parameter, State, symbol
from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

HEIGHT, SPEED, SIDE, W = (symbol(n) for n in ("height", "speed", "side", "w"))


# -- co-simulation ---------------------------------------------------------------------------


def ball(start, *events):
    """A ball on a floor, and a counter of events."""
    return Component(
        "ball",
        "a ball",
        states=(
            State("height", "m", "height", SPEED, start=1.0),
            State("speed", "m/s", "speed", -9.81 + 0 * HEIGHT, start=start),
            State("side", "1", "side", 0 * SIDE),
        ),
        inputs=(Input("w", "1", "watched", start=-1.0),),
        outputs=(Output("h", "m", "height", HEIGHT), Output("s", "1", "side", SIDE)),
        modes=(
            Mode("flies", events=(Event("bounce", HEIGHT, -1, {"speed": -0.8 * SPEED}), *events)),
        ),
    )


@pytest.mark.parametrize("kind", ["readable", "native-2"])
def test_events_without_end_fail_the_step_with_the_reason(written, kind):
    """Bounces with 0.8 of the speed accumulate at sqrt(2/g) (1 + 2 * 0.8/0.2) = 4.0638 s."""
    host = Host(written(ball(0.0), kind))
    with pytest.raises(Exception, match="DoStep"):
        host.step(0.0, 5.0)
    said = "instance: events follow each other without end at t = 4.06"
    assert host.message().startswith(said)
    host.close()


# -- both kinds of simulation ------------------------------------------------------------------


def test_a_ball_bounces_when_it_must_in_both_kinds_of_simulation(written):
    """From 1 m, bounced at 0.4515 s with 0.8 of its speed; a switch watches 0.5 m either way.

    One event is due at the start.
    """
    cross = Event("cross", HEIGHT - 0.5 + 0 * W, 0, {"side": SIDE + 1})
    part = ball(0.0, cross, Event("begins", 0.5 - SIDE, 1, {"side": SIDE + 1}))
    path = written(part, "native-2")
    assert validate_fmu(str(path)) == []
    g, speed = 9.81, np.sqrt(2 * 9.81)
    ground = speed / g
    for kind, tolerance in (("CoSimulation", 1e-9), ("ModelExchange", 1e-5)):
        course = fmpy.simulate_fmu(
            str(path), fmi_type=kind, stop_time=1.0, output_interval=1e-3, relative_tolerance=1e-9
        )
        t = course["time"]
        after = 0.8 * speed * (t - ground) - g / 2 * (t - ground) ** 2
        exact = np.where(t < ground, 1 - g / 2 * t**2, after)
        assert np.abs(course["h"] - exact).max() <= tolerance
        assert (course["s"][0], course["s"][-1]) == (1.0, 4.0)
    assert Model(generate(part)).simulate(np.array([0.0, 1.0])).outputs["s"][-1] == 4.0


# -- model exchange ----------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", [2, pytest.param(3, marks=pytest.mark.prove)])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.ci if n == "plant_classical" else pytest.mark.prove)
        for n in COMPONENTS
    ],
)
def test_courses_are_as_near_to_co_simulation_as_its_own_perturbed_ones(name, fmi, tmp_path):
    kernel, path = COMPONENTS[name].made(fmi, tmp_path)
    outcomes = [outcome(kernel, path, one) for one in cases(name, fmi, 5)]
    assert [c for c in map(complaint, outcomes) if c] == []
    assert sum(o.travel > 1e-6 for o in outcomes) >= 3  # they break away


@pytest.fixture(scope="module")
def watched(written):
    """A ball, and a switch at zero of an input."""
    return written(ball(-1.0, Event("switch", W, 0, {"side": SIDE + 1})), "native-2")


def test_an_event_is_due_from_half_of_the_margin_on_which_is_a_trillionth_of_the_nominal(watched):
    """The host sees an indicator less the margin, so that zero is beyond the event."""

    def at(height, *course):
        """Indicators at its end, whether that asks for events, and how many happen there."""
        host = Host(watched, {"w": course[0]}, exchange=True)
        host.fmu.enterContinuousTimeMode()
        host.set_states([height, -1.0, 0.0])
        for w in course[1:]:
            host.set({"w": w})
            shown = host.array("getEventIndicators", 2)
            asked = host.fmu.completedIntegratorStep()[0] != 0
        host.fmu.enterEventMode()
        changed = host.update()
        (side,) = host.get("s")
        bounced = host.array("getContinuousStates", 3)[1] > 0
        host.close()
        assert changed == (bounced or side > 0)
        return shown, asked, bounced, side

    shown, *happened = at(0.5, -1.0, -0.25)
    assert happened == [False, False, 0.0]
    assert shown == pytest.approx([-0.5 - 1e-12, -0.25 - 1e-12], rel=0, abs=1e-15)
    for share, due, asked in ((0.4, False, False), (0.6, True, False), (1.1, True, True)):
        assert at(-share * 1e-12, -1.0, -0.25)[1:] == (asked, due, 0.0)
        assert at(0.5, -1.0, share * 1e-12)[1:] == (asked, False, float(due))
    # from zero its first side is where it goes, and the way back is an event
    assert at(0.5, 0.0, -1.0, 1.0)[1:] == (True, False, 1.0)


def test_events_that_reset_or_watch_either_way_leave_no_indicator_at_zero(watched):
    """Stopped exactly where both indicators are zero."""
    host = ExchangeHost(watched, {}, 1e-6, np.random.default_rng(0))

    def event(states, values):
        host.put_states(host.time, np.array(states))
        host.jump(values)
        assert (host.z != 0.0).all()
        return host.x.tolist()

    assert event([-1e-12, -1.0, 0.0], {"w": 1e-12}) == [-1e-12, 0.8, 1.0]  # both, exactly there
    assert event([-1e-12, 0.8, 1.0], {"w": 1e-12}) == [-1e-12, 0.8, 1.0]  # and once only
    assert event([1e-3, 0.8, 1.0], {"w": 1e-3}) == [1e-3, 0.8, 1.0]  # leaving is no event
    assert event([1e-3, -0.8, 1.0], {"w": -1e-12}) == [1e-3, -0.8, 2.0]  # the switch goes back
    assert event([-1e-6, -1.0, 2.0], {"w": -1.0}) == [-1e-6, 0.8, 2.0]
    # it does not fall through the floor where it falls again before it was above
    assert event([-2e-6, -0.5, 2.0], {"w": -1.0}) == [-2e-6, 0.4, 2.0]
    host.close()


# -- delays --------------------------------------------------------------------------------------


U, X, HEARD, SEEN, TAU = map(symbol, ("u", "x", "heard", "seen", "tau"))

LOOP = Component(
    "late_loop",
    "A lag that hears its command late, and feels itself as it was",
    parameters=(Parameter("tau", 0.013, "s", "delay", "made up", minimum=0.0),),
    inputs=(Input("u", "V", "command"),),
    states=(State("x", "V", "lag", 40 * (HEARD - X - 0.6 * SEEN * X), start=0.2),),
    outputs=(
        Output("x", "V", "lag", X),
        Output("heard", "V", "command, late", HEARD),
        Output("twice", "V", "command, later", symbol("later")),
    ),
    delays=(
        Delay("heard", U, TAU, unit="V"),
        Delay("seen", X, 3 * TAU, unit="V", start=0.2),
        Delay("later", HEARD, TAU / 2, unit="V", start=-1.0),
    ),
)
OUTPUTS = ("x", "heard", "twice")
rare = pytest.mark.ci
every_kind = pytest.mark.parametrize(
    "kind", [k if k != "native-3" else pytest.param(k, marks=rare) for k in KINDS]
)


def command(k):
    return float((k * k) % 7) / 3.0


@every_kind
def test_an_fmu_gives_the_numbers_of_the_model(written, kind):
    host, model = Host(written(LOOP, kind)), Model(generate(with_law_ports(LOOP)))
    for k in range(120):
        t = 1e-3 * k
        host.set({"u": command(k)})
        model.set_input("u", command(k))
        host.step(t, 1e-3)
        model.advance(t, t + 1e-3)
        y = model.outputs(t + 1e-3, model.x)
        assert host.get(*OUTPUTS) == [y[n] for n in OUTPUTS]
        assert y["heard"] == pytest.approx(command(k - 12) if k >= 12 else 0.0, abs=1e-9)
    host.close()


@every_kind
@pytest.mark.parametrize("steps", [7, 250])  # the latter are more than there is room for at first
def test_a_saved_state_holds_what_delayed_signals_were(written, kind, steps):
    host = Host(written(LOOP, kind))
    h = 0.05 / steps

    def go_on(host, first):
        seen = []
        for k in range(first, first + steps):
            host.set({"u": command(k)})
            host.step(h * k, h)
            seen.append(host.get(*OUTPUTS))
        return seen

    begin = go_on(host, 0)
    state = host.fmu.getFMUState()
    data = bytes(host.fmu.serializeFMUState(state))
    expected = go_on(host, steps)
    go_on(host, 2 * steps)
    host.fmu.setFMUState(state)
    assert go_on(host, steps) == expected
    other = Host(written(LOOP, kind))
    other.fmu.setFMUState(other.fmu.deserializeFMUState(data))
    assert other.get(*OUTPUTS) != [0.2, 0.0, -1.0]
    assert go_on(other, steps) == expected
    other.fmu.reset()
    other.begin()
    assert go_on(other, 0) == begin
    host.close()
    other.close()


@every_kind
def test_a_delay_that_lasts_no_time_fails_with_one_line(written, kind):
    host = Host(written(LOOP, kind), {"tau": 0.0})
    with pytest.raises(Exception, match="DoStep"):
        host.step(0.0, 1e-3)
    assert host.message() == "instance: a delay is 0 s; expected more than 0 s"
    host.close()


def test_a_feedback_law_knows_how_fast_a_delayed_signal_moves():
    late = Component(
        "late_gain",
        "A gain on a late ramp",
        inputs=(Input("x", "m", "position", role="measurement"),),
        outputs=(Output("u", "V", "command", X - 3 * HEARD),),
        delays=(Delay("heard", X + 0.5 * TIME, sp.Float(0.1)),),
    )
    model = Model(generate(with_law_ports(late)))
    model.advance(0.0, 0.25)
    y = model.outputs(0.25, model.x)
    assert y["u"] == pytest.approx(-3 * 0.5 * 0.15)
    assert y["u_gain_x"] == 1.0
    assert y["u_rate"] == pytest.approx(-1.5)
