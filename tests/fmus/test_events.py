"""Components with modes and events as FMUs, in co-simulation and under hosts of model exchange.

``proofs/interoperability/exchange.py`` runs 200 courses of model exchange; here is a sample of the
same seeds.
"""

import fmpy
import numpy as np
import pytest
from any_fmu import Host, written
from exchange_courses import COMPONENTS, cases, complaint, outcome
from exchange_host import ExchangeHost
from fmpy.validation import validate_fmu

from ballscrew.fmus.native.export import export_native
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Event, Input, Mode, Output, State, symbol
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
def test_events_without_end_fail_the_step_with_the_reason(tmp_path, kind):
    """Bounces with 0.8 of the speed accumulate at sqrt(2/g) (1 + 2 * 0.8/0.2) = 4.0638 s."""
    host = Host(written(ball(0.0), kind, tmp_path))
    with pytest.raises(Exception, match="DoStep"):
        host.step(0.0, 5.0)
    said = "instance: events follow each other without end at t = 4.06"
    assert host.message().startswith(said)
    host.close()


# -- both kinds of simulation ------------------------------------------------------------------


def test_a_ball_bounces_when_it_must_in_both_kinds_of_simulation(tmp_path):
    """From 1 m, bounced at 0.4515 s with 0.8 of its speed; a switch watches 0.5 m either way."""
    part = ball(0.0, Event("cross", HEIGHT - 0.5 + 0 * W, 0, {"side": SIDE + 1}))
    path = export_native(part, tmp_path / "ball.fmu").path
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
        assert course["s"][-1] == 3.0
    model = Model(generate(part))
    assert model.simulate(np.array([0.0, 1.0])).outputs["s"][-1] == 3.0


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
def watched(tmp_path_factory):
    """A ball, and a switch at zero of an input."""
    part = ball(-1.0, Event("switch", W, 0, {"side": SIDE + 1}))
    return export_native(part, tmp_path_factory.mktemp("ball") / "ball.fmu").path


def test_an_event_is_due_from_half_of_the_margin_on_which_is_a_trillionth_of_the_nominal(watched):
    """The host sees an indicator less the margin, so that zero is beyond the event."""

    def at(height, w):
        """Indicators there, whether a completed step asks for events, and how many happen."""
        host = Host(watched, {"w": -1.0}, exchange=True)
        host.fmu.enterContinuousTimeMode()
        host.set_states([height, -1.0, 0.0])
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

    shown, *happened = at(0.5, -0.25)
    assert happened == [False, False, 0.0]
    assert shown == pytest.approx([-0.5 - 1e-12, -0.25 - 1e-12], rel=0, abs=1e-15)
    for share, due, asked in ((0.4, False, False), (0.6, True, False), (1.1, True, True)):
        assert at(-share * 1e-12, -0.25)[1:] == (asked, due, 0.0)
        assert at(0.5, share * 1e-12)[1:] == (asked, False, float(due))


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
