"""Components joined into one: equations by hand say the same, whatever the order of the parts."""

from __future__ import annotations

import math
import re
import runpy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    ContractError,
    Delay,
    DiscreteState,
    Event,
    ForceBalance,
    ForceTerm,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.interconnect import interconnect
from ballscrew.solver.kernel import Model

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "several-parts.md"
A, U = symbol("a"), symbol("u")
PERIOD = Parameter("sample_time", 0.1, "s", "period", "made up")
GOAL, STOP = 0.08, 0.6


# -- the page's plants against equations by hand -------------------------------------------------


@pytest.fixture(scope="module")
def mine(tmp_path_factory) -> Path:
    """The file on the page."""
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    path = tmp_path_factory.mktemp("page") / "mine.py"
    path.write_text(code, encoding="utf-8")
    return path


@cache
def defaults(name: str) -> dict[str, float]:
    return {p.name: p.default for p in ballscrew.component(name).all_parameters}


def screw_rates(state, voltage, force, p):
    """Eqs. 3.9-3.16 by hand: block, motor and bristles under a force."""
    _, v, i, z = state
    turn = 2 * math.pi * p["p"]
    sign = 2 / math.pi * math.atan(p["Kv"] * v)
    curve = p["Fc"] + (p["Fs"] - p["Fc"]) * math.exp(-((v / p["Vs"]) ** 2))
    bristles = sign**2 * v - p["sigma0"] * sign * v / curve * z
    friction = p["sigma0"] * z + p["sigma1"] * bristles + p["sigma2"] * v
    inertia = p["m"] + p["Jm"] * turn**2
    acceleration = (p["kt"] * turn * i - friction + force) / inertia
    return [v, acceleration, (voltage - p["R"] * i - p["ke"] * turn * v) / p["L"], bristles]


def course_by_hand(rates, states, times):
    """States of a loop under PID, whose integral is the last; shape (m, states + 1)."""
    p = defaults("pid")

    def loop(_, y):
        x, v, of_plant = rates(y[:-1])
        voltage = p["Kp"] * (GOAL - x) + p["Ki"] * y[-1] - p["Kd"] * v
        return [*of_plant(voltage), GOAL - x]

    start = np.zeros(states + 1)
    found = solve_ivp(
        loop, (0.0, STOP), start, "LSODA", t_eval=times, rtol=1e-9, atol=1e-13, first_step=1e-9
    )
    assert found.success
    return found.y.T


def geared(y):
    p, screw, slide = defaults("plant"), y[:4], y[4:]
    ratio, stiffness, damping = 0.5, 2e5, 50.0
    force = stiffness * (ratio * screw[0] - slide[0]) + damping * (ratio * screw[1] - slide[1])

    def rates(voltage):
        moved = screw_rates(screw, voltage, -ratio * force, p)
        return [*moved, slide[1], (force - 10.0 * slide[1]) / 2.0]

    return screw[0], screw[1], rates


def two_screws(y):
    p, left, right = defaults("plant"), y[:4], y[4:]
    force = 1e4 * (right[0] - left[0])

    def rates(voltage):
        heavy = screw_rates(left, voltage, force, p | {"m": 1.5})
        return [*heavy, *screw_rates(right, voltage, -force, p)]

    return (left[0] + right[0]) / 2, (left[1] + right[1]) / 2, rates


@pytest.mark.parametrize(
    ("plant", "by_hand", "states", "seen"),
    [
        ("axis", geared, 6, {"x": lambda y: y[:, 0], "x_payload": lambda y: y[:, 4]}),
        (
            "gantry",
            two_screws,
            8,
            {"x": lambda y: (y[:, 0] + y[:, 4]) / 2, "skew": lambda y: y[:, 0] - y[:, 4]},
        ),
    ],
)
def test_a_plant_of_several_parts_runs_as_its_equations_by_hand(mine, plant, by_hand, states, seen):
    result = ballscrew.run("pid", f"{mine}:{plant}", reference=GOAL, stop=STOP, step=1e-3)
    assert result.trusted
    exact = course_by_hand(by_hand, states, result.run.time)
    for name, value in seen.items():
        expected = value(exact)
        apart = np.abs(result.run.outputs[name] - expected).max() / np.ptp(expected)
        assert apart < 1e-5, name
    # and as one system of equations in one solver
    whole = ballscrew.connect(ballscrew.component(f"{mine}:{plant}"), ballscrew.component("pid"))
    model = Model(generate(whole), tolerance=1e-9)
    model.set_input("x_d", GOAL)
    course = model.simulate(result.run.time)
    for name, value in seen.items():
        np.testing.assert_allclose(course.outputs[name], value(exact), rtol=1e-6, atol=1e-11)


def test_two_equal_screws_on_one_command_move_as_one(mine):
    """The beam between them has nothing to do."""
    page = runpy.run_path(str(mine))
    pid = ballscrew.component("pid")
    sides = ("left", "right")
    twin = interconnect(
        {"left": page["screw"](), "right": page["screw"](), "beam": page["beam"]()},
        {
            **{f"{side}.u": "u" for side in sides},
            **{f"{side}.force": f"beam.on_{side}" for side in sides},
            **{f"beam.{q}_{side}": f"{side}.{q}" for side in sides for q in ("x", "v")},
        },
        ["u"],
        {name: f"beam.{name}" for name in ("x", "v", "skew")},
    )
    times = np.linspace(0.0, STOP, 61)
    courses = []
    for plant in (twin, ballscrew.component("plant")):
        model = Model(generate(ballscrew.connect(plant, pid)), tolerance=1e-9)
        model.set_input("x_d", GOAL)
        courses.append(model.simulate(times).outputs)
    both, one = courses
    assert np.abs(both["skew"]).max() < 1e-15
    np.testing.assert_allclose(both["x"], one["x"], rtol=1e-6, atol=1e-12)


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


def mean(number):
    """Sampled, and its output follows its input at once, too."""
    held = symbol("d")
    return Component(
        "mean",
        "mean",
        inputs=(Input("a", "1", "a"),),
        discrete=(DiscreteState("d", "1", "d", held + (A - held) / (3 + number)),),
        outputs=(Output("y", "1", "y", held + A / 2),),
        sample_time=PERIOD,
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
        kinds = [gain, lag, mean, late, *([climber] if k < 3 else [])]
        parts[f"p{k}"] = draw(st.sampled_from(kinds))(k)
        takes[f"p{k}"] = draw(st.sampled_from(["u", *(f"p{j}" for j in range(k))]))
    first = draw(st.integers(0, count - 1))
    return parts, takes, list(parts)[first : draw(st.integers(first + 1, count))]


def joined(parts, takes, seen):
    wires = {f"{n}.a": takes[n] if takes[n] == "u" else f"{takes[n]}.y" for n in parts}
    outer = [Input(n, "1", n) for n in dict.fromkeys(wires.values()) if "." not in n]
    return interconnect(parts, wires, outer, {n: f"{n}.y" for n in seen})


@settings(max_examples=60, deadline=None)
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


def hold(name):
    """Takes its input at each sample."""
    return Component(
        name,
        name,
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


# -- modes ---------------------------------------------------------------------------------------


def sticking(start):
    """A mass on a spring with dry friction, as modes."""
    x, v = symbol("x"), symbol("v")
    body = Component(
        "mass",
        "a mass that sticks and slides",
        states=(State("x", "m", "position", v, start=start), State("v", "m/s", "velocity")),
        outputs=(Output("x", "m", "position", x),),
        balances=(ForceBalance("v", sp.Integer(1), (ForceTerm("spring", -x, "spring"),)),),
    )
    return ballscrew.with_friction(body, "classical", {"Fc": 1.0, "Fs": 1.0, "sigma2": 0.0})


def test_two_masses_that_stick_have_nine_modes_and_move_as_each_alone():
    alone = {"near": sticking(5.5), "far": sticking(8.3)}
    both = interconnect(alone, {}, [], {n: f"{n}.x" for n in alone})
    assert len(both.modes) == 9
    assert both.modes[0].name == "stuck_stuck"
    times = np.linspace(0.0, 15.0, 151)
    course = Model(generate(both), tolerance=1e-10).simulate(times)
    for name, part in alone.items():
        expected = Model(generate(part), tolerance=1e-10).simulate(times).outputs["x"]
        np.testing.assert_allclose(course.outputs[name], expected, atol=1e-8)


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
        ({"inputs": []}, "one.a takes 'u', which is not an output of any part"),
        ({"outputs": {"y": "u"}}, "y takes 'u', which is not an output of any part"),
        (
            {
                "parts": {
                    "one": hold("one"),
                    "two": replace(hold("two"), sample_time=replace(PERIOD, default=0.3)),
                }
            },
            "one samples every 0.1 s and two every 0.3 s; expected one period",
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


def test_a_sampler_of_a_signal_that_modes_change_is_refused():
    """Its update would be that of one mode in all of them."""
    switch = Component(
        "switch",
        "switch",
        outputs=(Output("y", "1", "y", sp.Integer(0)),),
        modes=(Mode("off"), Mode("on", outputs={"y": sp.Integer(1)})),
    )
    with pytest.raises(ContractError, match="'hold_d' samples a signal that depends on the mode"):
        interconnect({"switch": switch, "hold": hold("hold")}, {"hold.a": "switch.y"}, [], {})


def test_an_outer_input_is_what_takes_it_and_its_law_acts_on_what_is_seen():
    plant = ballscrew.component("plant")
    whole = interconnect(
        {"axis": plant}, {"axis.u": "w"}, ["w"], {"place": "axis.x", "i": "axis.i"}
    )
    (port,) = whole.inputs
    assert port == replace(plant.inputs[0], name="w", law=("place", "i"))
