"""What a description calls discrete stays as it is between events; FMI 2.2.7 and 3.0, 2.4.7.4."""

from functools import cache

import pytest
import sympy as sp
from exported_loops import IN_LOOPS
from lxml import etree

from ballscrew.fmus.catalogue import NAMES, component, fmu_kernel, loop
from ballscrew.fmus.export import with_law_ports
from ballscrew.fmus.interface import interface_of
from ballscrew.fmus.model_description import model_description
from ballscrew.fmus.native import description, description3
from ballscrew.fmus.native.sources import catalogued_model
from ballscrew.solver.component import (
    TIME,
    Component,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)

LOOPS = {f"{name}_loop": name for name in IN_LOOPS}
FORMS = {
    "readable": lambda name: readable(kernel_of(name)),
    "native, FMI 2": lambda name: description.description_of(native_of(name), "t"),
    "native, FMI 3": lambda name: description3.description_of(native_of(name), "t"),
}


def readable(kernel):
    return model_description(kernel, interface_of(kernel, kernel.name))


def kernel_of(name):
    return fmu_kernel(LOOPS[name], "plant") if name in LOOPS else fmu_kernel(name)


@cache
def part_of(name):
    return loop(LOOPS[name]) if name in LOOPS else with_law_ports(component(name))


@cache
def native_of(name):
    return catalogued_model(LOOPS[name], "plant") if name in LOOPS else catalogued_model(name)


def variables(xml):
    """Variability of each variable, and the names of states that have a derivative."""
    root = etree.fromstring(xml)
    listed = list(root.find("ModelVariables"))
    names = [v.get("name") for v in listed]
    by_reference = {v.get("valueReference"): v.get("name") for v in listed}
    states = []
    for v in listed:
        derivative = v.get("derivative") or (len(v) and v[0].get("derivative"))
        if derivative:
            fmi3 = v.get("derivative") is not None
            states.append(by_reference[derivative] if fmi3 else names[int(derivative) - 1])
    return {v.get("name"): v.get("variability", "continuous") for v in listed}, states


def moves(part, output):
    """Whether its equation, in any mode, has a continuous state, an input or the time in it."""
    own = [m.outputs[output.name] for m in part.modes if output.name in m.outputs]
    used = set().union(*(sp.sympify(e).free_symbols for e in (output.value, *own)))
    moving = {symbol(v.name) for v in (*part.all_states, *part.inputs)} | {TIME}
    return bool(used & moving)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", [*NAMES, *LOOPS])
def test_nothing_that_moves_between_events_is_discrete(name, form):
    part = part_of(name)
    said, states = variables(FORMS[form](name))
    for output in part.all_outputs:
        if moves(part, output):
            assert said[output.name] == "continuous", output.name
        elif part.sample_time:
            assert said[output.name] == "discrete", output.name
    assert [s for s in states if said[s] != "continuous"] == []
    assert len(states) == (0 if form == "readable" else len(part.all_states))
    slopes = {n for n in said if n.startswith("der(")}
    assert {said[n] for n in slopes} <= {"continuous"}


def test_a_sampled_loop_s_position_is_continuous_and_its_held_voltage_discrete():
    said, _ = variables(readable(kernel_of("pid_sampled_loop")))
    assert [said[n] for n in ("x", "v", "z", "i", "friction")] == ["continuous"] * 5
    assert "discrete" in {v for n, v in said.items() if n != "message"}


def test_the_time_an_input_or_a_state_makes_an_output_of_a_sampled_part_continuous():
    from ballscrew.solver.codegen import generate

    held, w, x = symbol("held"), symbol("w"), symbol("x")
    values = {"a": held, "b": held + w, "c": held * TIME, "d": x - held, "e": 2 * symbol("k")}
    part = Component(
        "mixed",
        "a sampled part",
        parameters=(Parameter("k", 1.0, "1", "gain", "the test"),),
        inputs=(Input("w", "1", "input"),),
        states=(State("x", "1", "state", w),),
        outputs=tuple(Output(n, "1", n, v) for n, v in values.items()),
        discrete=(DiscreteState("held", "1", "held", w),),
        sample_time=Parameter("period", 1.0, "s", "period", "the test", minimum=1e-6),
    )
    said, _ = variables(readable(generate(part)))
    assert {n: said[n][0] for n in values} == {"a": "d", "b": "c", "c": "c", "d": "c", "e": "d"}
