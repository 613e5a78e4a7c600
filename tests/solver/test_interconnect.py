"""Components joined into one: equations by hand say the same, whatever the order of the parts."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from networks_of_parts import CHAIN, LINKS, link, whole_chain

import ballscrew
from ballscrew import Component, Delay, DiscreteState, Event, ForceBalance, ForceTerm, Input, Mode
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Output, Parameter, State, symbol
from ballscrew.solver.errors import ContractError
from ballscrew.solver.interconnect import interconnect
from ballscrew.solver.kernel import Model

A, U = symbol("a"), symbol("u")
PERIOD = Parameter("sample_time", 0.1, "s", "period", "made up")
SLOW = replace(PERIOD, default=0.3)


def test_a_chain_of_parts_moves_as_its_matrix_exponential():
    parts = {f"m{k}": link() for k in range(LINKS)}
    wires = dict(reversed(c.split(" -> ")) for c in CHAIN)
    ends = ["m0.before", f"m{LINKS - 1}.after"]
    chain = interconnect(
        parts, wires | dict.fromkeys(ends, "wall"), ["wall"], {n: f"{n}.x" for n in parts}
    )
    times = np.linspace(0.0, 2.0, 9)
    course = Model(generate(chain), {"m0_push": 3.0}, tolerance=1e-10).simulate(times)
    exact = whole_chain(times, 3.0)
    for k, name in enumerate(parts):
        np.testing.assert_allclose(course.outputs[name], exact[:, k], atol=1e-9)


# -- any order, any grouping ---------------------------------------------------------------------


def gain(number):
    return Component(
        "gain",
        "gain",
        parameters=(Parameter("k", 2.0 + number, "1", "gain", "made up"),),
        inputs=(Input("a", "1", "a"),),
        outputs=(Output("y", "1", "y", symbol("k") * A),),
    )


def lag(number):
    return Component(
        "lag",
        "lag",
        inputs=(Input("a", "1", "a"),),
        states=(State("x", "1", "x", A - (1 + number) * symbol("x")),),
        outputs=(Output("y", "1", "y", symbol("x")),),
    )


def late(number):
    return Component(
        "late",
        "late",
        inputs=(Input("a", "1", "a"),),
        outputs=(Output("y", "1", "y", symbol("then")),),
        delays=(Delay("then", A, sp.Integer(1 + number)),),
    )


def climber(number):
    """Two modes with their own rates, and an output that both share."""
    x, up, down = symbol("x"), f"up{number}", f"down{number}"
    return Component(
        "climber",
        "climber",
        inputs=(Input("a", "1", "a"),),
        states=(State("x", "1", "x", A),),
        outputs=(Output("y", "1", "y", x),),
        modes=(
            Mode(up, {"x": A + 1}, events=(Event(f"top{number}", x - A - 1, 1, {"x": A}, down),)),
            Mode(down, {"x": A - 1}, events=(Event(f"foot{number}", x - A + 1, -1, {}, up),)),
        ),
    )


def meaning(whole):
    """All equations by what they are of, with the names that the parts have without a group."""
    own = [*whole.all_parameters, *whole.all_states, *whole.discrete, *whole.delays]
    table = {symbol(p.name): symbol(p.name.removeprefix("group_")) for p in own}

    def told(equations):
        pairs = {n: sp.sympify(e).xreplace(table) for n, e in equations.items()}
        return {n.removeprefix("group_"): e for n, e in pairs.items()}

    def choice(name):
        return frozenset(name.split("_"))

    names = [s.name for s in whole.all_states]
    modes = {
        choice(mode.name): (
            told(mode.derivatives),
            told(mode.outputs),
            {
                e.name: (told({"": e.indicator}), told(e.reset), choice(e.next_mode))
                for e in mode.events
            },
        )
        for mode in whole.modes
    }
    return (
        told(dict(zip(names, whole.derivatives, strict=True))),
        told({d.name: d.update for d in whole.discrete}),
        told({o.name: o.value for o in whole.all_outputs}),
        told({d.name: d.expression for d in whole.delays}),
        modes,
    )


@st.composite
def networks(draw):
    """Parts in the order of the signals, what each takes, and a row of neighbours among them."""
    count = draw(st.integers(2, 5))
    parts, takes = {}, {}
    for k in range(count):
        kinds = [gain, lag, late, hold, *([climber] if k < 3 else [])]
        parts[f"p{k}"] = draw(st.sampled_from(kinds))(k)
        takes[f"p{k}"] = draw(st.sampled_from(["u", *(f"p{j}" for j in range(k))]))
    first = draw(st.integers(0, count - 1))
    return parts, takes, list(parts)[first : draw(st.integers(first + 1, count))]


def joined(parts, takes, seen):
    wires = {f"{n}.a": takes[n] if takes[n] == "u" else f"{takes[n]}.y" for n in parts}
    outer = [Input(n, "1", n) for n in dict.fromkeys(wires.values()) if "." not in n]
    return interconnect(parts, wires, outer, {n: f"{n}.y" for n in seen})


@settings(max_examples=30, deadline=None)
@given(networks(), st.randoms(use_true_random=False))
def test_neither_order_nor_grouping_changes_an_equation(network, random):
    parts, takes, group = network
    expected = meaning(joined(parts, takes, parts))
    order = list(parts)
    random.shuffle(order)
    assert meaning(joined({n: parts[n] for n in order}, takes, parts)) == expected
    # some of them as a component of their own, which is then a part
    inner = {n: takes[n] if takes[n] in group else "a" for n in group}
    sources = {takes[n] for n in group} - {*group}
    if len(sources) > 1:  # one outer input for each
        inner = {n: takes[n] if takes[n] in group else f"of_{takes[n]}" for n in group}
    wires = {f"{n}.a": f"{s}.y" if s in group else s for n, s in inner.items()}
    ports = dict.fromkeys(s for s in wires.values() if "." not in s)
    one = interconnect(
        {n: parts[n] for n in group},
        wires,
        [Input(n, "1", n) for n in ports],
        {f"y_{n}": f"{n}.y" for n in group},
    )
    outside = [n for n in order if n not in group]

    def place(source):
        return f"group.y_{source}" if source in group else f"{source}.y" if source != "u" else "u"

    fed = {n: place(takes[n]) for n in outside}
    whole = interconnect(
        {n: parts[n] for n in outside} | {"group": one},
        {f"{n}.a": s for n, s in fed.items()}
        | {f"group.{inner[n]}": place(takes[n]) for n in group if takes[n] not in group},
        [Input("u", "1", "u")],
        {n: place(n) for n in parts},
    )
    assert meaning(whole) == expected


# -- sampling ------------------------------------------------------------------------------------


def hold(_):
    """Takes its input at each sample."""
    return Component(
        "hold",
        "hold",
        inputs=(Input("a", "1", "a"),),
        discrete=(DiscreteState("d", "1", "d", A),),
        outputs=(Output("y", "1", "y", symbol("d")),),
        sample_time=PERIOD,
    )


def test_what_is_sampled_passes_through_all_parts_at_one_instant():
    parts = {n: hold(n) for n in ("last", "middle", "first")}
    wires = {"first.a": "u", "middle.a": "first.y", "last.a": "middle.y"}
    whole = interconnect(parts, wires, ["u"], {"y": "last.y"})
    assert [d.update for d in whole.discrete] == [U, U, U]
    assert whole.sample_time == PERIOD


def test_in_a_circle_of_samplers_the_first_sees_what_was_before():
    wires = {"one.a": "two.y", "two.a": "one.y", "behind.a": "two.y"}
    for first, second in (("one", "two"), ("two", "one")):
        parts = {n: hold(n) for n in ("behind", first, second)}
        whole = interconnect(parts, wires, [], {"y": "behind.y"})
        updates = {d.name: d.update for d in whole.discrete}
        before = symbol(f"{second}_d")
        assert updates == {f"{n}_d": before for n in parts}


# -- what is refused -----------------------------------------------------------------------------


def test_an_output_that_follows_at_once_is_a_loop_only_where_it_comes_back():
    wires = {"one.a": "two.y", "two.a": "three.y", "three.a": "one.y"}
    gains = {n: replace(gain(0), name=n) for n in ("one", "two", "three")}
    line = "^one and two and three: 'y' depends on the one's input without delay, which makes"
    with pytest.raises(ContractError, match=line):
        interconnect(gains, wires, [], {})
    whole = interconnect(gains | {"two": hold("two")}, wires, [], {"y": "one.y"})
    (update,) = (d.update for d in whole.discrete)
    assert update == symbol("three_k") * symbol("one_k") * symbol("two_d")


SWITCH = Component(
    "switch",
    "switch",
    outputs=(Output("y", "1", "y", sp.Integer(0)),),
    modes=(Mode("off"), Mode("on", outputs={"y": sp.Integer(1)})),
)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            {"connections": {"one.a": "u", "two.a": "on.y"}},
            "two.a takes 'on.y', which is not an output of any part",
        ),
        ({"connections": {"one.a": "u", "two.b": "one.y"}}, "no part has an input 'two.b'; there"),
        ({"connections": {"one.a": "u"}}, "two.a is not connected; it needs a connection"),
        ({"inputs": ["u", "w"]}, "no input is connected to the outer input 'w'"),
        (
            {
                "parts": {
                    "one": hold("one"),
                    "two": replace(hold("two"), name="slow", sample_time=SLOW),
                }
            },
            "hold samples every 0.1 s and slow every 0.3 s; expected one period",
        ),
        (
            {"parts": {"one": SWITCH, "two": hold("two")}, "connections": {"two.a": "one.y"}}
            | {"inputs": []},
            "'two_d' samples a signal that depends on the mode",
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_one_line(change, line):
    fitting = {
        "parts": {"one": gain(0), "two": gain(1)},
        "connections": {"one.a": "u", "two.a": "one.y"},
        "inputs": ["u"],
        "outputs": {"y": "two.y"},
    }
    assert interconnect(**fitting).name == "one_two"
    with pytest.raises(ContractError, match=re.escape(line)):
        interconnect(**(fitting | change))


COULOMB, EXTRA, DAMPING = 1.0, 0.5, 0.4


def mass():
    """One kilogram with Coulomb friction that sticks."""
    x, v, u = map(symbol, ("x", "v", "u"))
    body = Component(
        name="mass",
        description="a mass that sticks and slides",
        inputs=(Input("u", "N", "force", law=("x", "v")),),
        states=(State("x", "m", "position", v, start=8.0), State("v", "m/s", "velocity")),
        outputs=(Output("x", "m", "position", x), Output("v", "m/s", "velocity", v)),
        balances=(ForceBalance("v", sp.Integer(1), (ForceTerm("drive", u, "force"),)),),
    )
    friction = {"Fc": COULOMB, "Fs": COULOMB, "sigma2": 0.0}
    return ballscrew.with_friction(body, "classical", friction)


def law():
    """A spring and a damper, and more than the friction in the direction of motion."""
    x, v, x_d = map(symbol, ("x", "v", "x_d"))
    push = (COULOMB + EXTRA) * sp.sign(v)
    return Component(
        name="law",
        description="pushes in the direction of motion",
        inputs=(
            Input("x", "m", "position", role="measurement"),
            Input("v", "m/s", "velocity", role="measurement"),
            Input("x_d", "m", "goal", role="reference"),
        ),
        states=(State("speed", "m/s", "filtered speed", sp.Abs(v) - symbol("speed")),),
        outputs=(Output("u", "N", "force", x_d - x - DAMPING * v + push),),
    )


def test_a_cycle_of_a_law_with_a_sign_has_its_exponent_in_closed_form():
    found = ballscrew.lyapunov(law(), mass(), stop=100.0, reference=0.0).motion
    frequency = math.sqrt(1.0 - DAMPING**2 / 4)
    ratio = math.exp(-math.pi * DAMPING / 2 / frequency)
    assert found.kind.value == "limit cycle"
    assert found.period == pytest.approx(2 * math.pi / frequency, rel=1e-7)
    swing = EXTRA * (1 + ratio) / (1 - ratio)
    assert found.amplitude["plant_x"] == pytest.approx(swing, rel=1e-3)
    assert found.limit == pytest.approx([0.0, -DAMPING / 2, -1.0], abs=1e-4)
