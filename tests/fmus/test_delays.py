"""Components with delays as FMUs of every kind."""

import pytest
import sympy as sp
from any_fmu import KINDS, Host, written

from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Delay,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model

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


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """``files(component, kind)``: its FMU."""
    folder, done = tmp_path_factory.mktemp("late"), {}

    def get(component, kind):
        key = component.name, kind
        return done[key] if key in done else done.setdefault(key, written(component, kind, folder))

    return get


def command(k):
    return float((k * k) % 7) / 3.0


@every_kind
def test_an_fmu_gives_the_numbers_of_the_model(files, kind):
    host, model = Host(files(LOOP, kind)), Model(generate(with_law_ports(LOOP)))
    for k in range(120):
        t = 1e-3 * k
        host.set({"u": command(k)})
        model.set_input("u", command(k))
        host.step(t, 1e-3)
        model.advance(t, t + 1e-3)
        y = model.outputs(t + 1e-3, model.x)
        assert host.get(*OUTPUTS) == [y[n] for n in OUTPUTS]
        late = command(k - 12) if k >= 12 else 0.0
        assert y["heard"] == pytest.approx(late, abs=1e-9)
    host.close()


@every_kind
@pytest.mark.parametrize("steps", [7, 250])  # the latter are more than there is room for at first
def test_a_saved_state_holds_what_delayed_signals_were(files, kind, steps):
    host = Host(files(LOOP, kind))
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
    other = Host(files(LOOP, kind))
    other.fmu.setFMUState(other.fmu.deserializeFMUState(data))
    assert other.get(*OUTPUTS) != [0.2, 0.0, -1.0]
    assert go_on(other, steps) == expected
    other.fmu.reset()
    other.begin()
    assert go_on(other, 0) == begin
    host.close()
    other.close()


@every_kind
def test_a_delay_that_lasts_no_time_fails_with_one_line(files, kind):
    host = Host(files(LOOP, kind), {"tau": 0.0})
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
