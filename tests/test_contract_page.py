"""The page about the component contract, `docs/contract.md`: its examples are what it says."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from ballscrew.plant.ball_screw import ball_screw
from ballscrew.plant.modified_lugre import modified_lugre
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    ContractError,
    DiscreteState,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model

PAGE = Path(__file__).resolve().parents[1] / "docs" / "contract.md"
EXAMPLES = (
    "modified LuGre plant",
    "sampled PI controller",
    "relay with hysteresis",
    "bouncing mass",
    "pure delay",
    "one more force term",
)


def blocks() -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)


@cache
def example(title: str) -> Component:
    namespace: dict[str, object] = {"__name__": "contract_page"}
    exec(compile(blocks()[EXAMPLES.index(title)], f"{PAGE.name}: {title}", "exec"), namespace)
    component = namespace["component"]
    assert isinstance(component, Component)
    return component


def model_of(title: str, values: dict[str, float] | None = None) -> Model:
    return Model(generate(example(title)), values)


def test_the_page_has_exactly_six_component_examples_under_their_titles():
    text = PAGE.read_text(encoding="utf-8")
    titles = re.findall(r"^### \(([a-z])\) (.+)$", text, re.M)
    assert [letter for letter, _ in titles] == list("abcdef")
    assert [title.lower() for _, title in titles] == [title.lower() for title in EXAMPLES]
    assert len(re.findall(r"^component = ", text, re.M)) == 6
    assert all("component = " in block for block in blocks()[:6])


@pytest.mark.parametrize("title", EXAMPLES)
def test_example_runs_alone_and_defines_a_component(title):
    component = example(title)
    assert component.name.isidentifier()
    assert component.all_outputs


@pytest.mark.parametrize("title", EXAMPLES)
def test_example_is_generated_and_simulates_to_finite_states_that_move(title):
    model = model_of(title)
    for k, i in enumerate(model.kernel.inputs):
        model.set_input(i.name, i.nominal / (k + 1))
    before = np.concatenate([model.x, model.u])
    step = model.sample_time or 1e-3
    for k in range(20):
        if model.sample_time:
            model.sample(k * step)
        trajectory = model.simulate([k * step, (k + 1) * step])
        for values in (*trajectory.states.values(), *trajectory.outputs.values()):
            assert np.isfinite(values).all()
    after = np.concatenate([model.x, model.u])
    assert np.isfinite(after).all()
    states = slice(0, len(model.x))
    first = len(model.x) + len(model.kernel.inputs)
    held = slice(first, first + len(model.kernel.discrete))
    for part in (states, held):
        assert (after[part] != before[part]).all()


def test_the_delay_passes_its_input_on_after_its_dead_time():
    model = model_of("pure delay")
    model.set_input("u", 3.0)
    course = model.simulate([0.0, 1e-3, 1.999e-3, 2e-3, 5e-3])
    assert course.outputs["u_late"].tolist() == [0.0, 0.0, 0.0, 3.0, 3.0]


def test_the_relay_has_two_modes_that_lead_to_each_other():
    modes = {m.name: [e.next_mode for e in m.events] for m in example(EXAMPLES[2]).modes}
    assert modes == {"off": ["on"], "on": ["off"]}


def test_the_relay_switches_beyond_its_hysteresis_only():
    model = model_of("relay with hysteresis")
    seen = []
    for k, error in enumerate((0.0, 2e-3, 0.0, -2e-3, 0.0)):
        model.set_input("error", error)
        model.advance(float(k), float(k + 1))
        seen.append(model.outputs(float(k + 1), model.x)["u"])
    assert seen == [-10.0, 10.0, 10.0, -10.0, -10.0]


def test_the_bouncing_mass_reverses_its_velocity_at_the_floor():
    (event,) = example("bouncing mass").modes[0].events
    assert event.indicator == symbol("height")
    values = {symbol("restitution"): 0.5, symbol("v"): -2.0}
    assert float(event.reset["v"].xreplace(values)) == 1.0


def test_the_modified_lugre_example_is_the_friction_of_this_project():
    ours, page = modified_lugre(symbol("v")), model_of("modified LuGre plant")
    values = {symbol(p.name): p.default for p in ours.parameters}
    assert {p.name: page.p[k] for k, p in enumerate(page.kernel.parameters)} == {
        "m": 1.0,
        **{s.name: default for s, default in values.items()},
    }
    page.set_input("u", 3.0)
    order = [s.name for s in page.kernel.states]
    for v, z in ((0.0, 2e-5), (4e-4, 1e-5), (-0.05, -1.9e-5), (0.2, 0.0)):
        at = {**values, symbol("v"): v, symbol("z"): z}
        state = {"x": 0.01, "v": v, "z": z}
        rate = dict(
            zip(order, page.derivatives(0.0, np.array([state[s] for s in order])), strict=True)
        )
        assert rate["x"] == v
        assert rate["v"] == pytest.approx(3.0 + float(ours.force.xreplace(at)), rel=1e-12)
        deflection = float(ours.states[0].derivative.xreplace(at))
        assert rate["z"] == pytest.approx(deflection, rel=1e-12, abs=1e-18)


def test_the_sampled_pi_sums_the_error_and_holds_its_command():
    gains = {"Kp": 3.0, "Ki": 20.0, "sample_time": 0.01}
    model = model_of("sampled PI controller", gains)
    model.set_input("v", 0.1)
    model.set_input("v_d", 0.35)
    for k in range(1, 6):
        model.sample((k - 1) * 0.01)
        command = 3.0 * 0.25 + 20.0 * k * 0.01 * 0.25
        assert model.outputs(0.0, model.x)["u"] == pytest.approx(command, rel=1e-12)
    model.set_input("v", 0.2)
    assert model.outputs(0.0, model.x)["u"] == pytest.approx(command, rel=1e-12)


@pytest.mark.parametrize("rotor", [0.0, 4.2e-7])
def test_the_extra_force_term_changes_the_acceleration_by_force_over_inertia(rotor):
    mass, per_metre, own = 1.7, 900.0, {"Fp": 0.4, "phase": 0.2, "Vp": 2e-3}
    shared = {"m": mass, "p": per_metre, "Jm": rotor}
    plain = Model(generate(ball_screw()), shared)
    more = model_of("one more force term", {**shared, **own})
    assert [s.name for s in more.kernel.states] == [s.name for s in plain.kernel.states]
    order = [s.name for s in plain.kernel.states]
    inertia = mass + rotor * (2 * math.pi * per_metre) ** 2
    for x, v in ((1e-4, 1e-3), (0.0314, -0.05), (-0.2, 3e-4), (0.05, 0.0)):
        state = np.array([{"x": x, "v": v, "i": 0.02, "z": 1e-5}[s] for s in order])
        without, with_term = plain.derivatives(0.0, state), more.derivatives(0.0, state)
        force = -0.4 * math.sin(2 * math.pi * per_metre * x + 0.2) * math.tanh(v / 2e-3)
        k = order.index("v")
        change = with_term[k] - without[k]
        assert change == pytest.approx(force / inertia, abs=1e-13 * (1 + abs(without[k])))
        assert more.outputs(0.0, state)["periodic_friction"] == pytest.approx(-force, rel=1e-12)
        others = [n for n in range(len(order)) if n != k]
        np.testing.assert_allclose(with_term[others], without[others], rtol=1e-12)


GAIN = Parameter("gain", 1.0, "1", "gain", "test", minimum=0.0, maximum=2.0)
PERIOD = Parameter("period", 0.1, "s", "period", "test")


def parts(**changes: object) -> dict[str, object]:
    """Arguments of a component that keeps the contract, but for the changes."""
    y = Output("y", "1", "output", symbol("gain") * symbol("q"))
    state = State("q", "1", "state", -symbol("q"))
    sound = {"parameters": (GAIN,), "states": (state,), "outputs": (y,)}
    return {"name": "broken", "description": "Something", **sound, **changes}


COUNT = DiscreteState("count", "1", "count", symbol("count") + 1)
VIOLATIONS = {
    "undeclared symbol": (
        {"outputs": (Output("y", "1", "output", symbol("ghost")),)},
        "output y uses 'ghost', which is not declared",
    ),
    "name declared twice": (
        {"parameters": (GAIN, Parameter("q", 1.0, "1", "again", "test"))},
        "'q' is declared as parameter and as state",
    ),
    "state without equation": (
        {"states": (State("q", "1", "state"),)},
        "state 'q' needs one equation",
    ),
    "discrete state without sample_time": (
        {"discrete": (COUNT,)},
        "the discrete state 'count' needs a sample_time",
    ),
    "default below its minimum": (
        {"parameters": (Parameter("gain", -1.0, "1", "gain", "test", minimum=0.0),)},
        "default -1.0 of 'gain' is not within [0.0, inf]",
    ),
    "default above its maximum": (
        {"parameters": (Parameter("gain", 3.0, "1", "gain", "test", maximum=2.0),)},
        "default 3.0 of 'gain' is not within [-inf, 2.0]",
    ),
    "symbol with other assumptions": (
        {"outputs": (Output("y", "1", "output", sp.Symbol("gain") * symbol("q")),)},
        "output y uses a symbol 'gain' with other assumptions",
    ),
}


@pytest.mark.parametrize("changes", [{}, {"discrete": (COUNT,), "sample_time": PERIOD}])
def test_a_component_that_keeps_the_contract_is_accepted(changes):
    assert Component(**parts(**changes)).name == "broken"


@pytest.mark.parametrize(("changes", "message"), VIOLATIONS.values(), ids=VIOLATIONS.keys())
def test_contract_error_names_the_component_and_the_offender(changes, message):
    with pytest.raises(ContractError, match=re.escape(f"broken: {message}")):
        Component(**parts(**changes))
