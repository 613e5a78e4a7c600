"""Variables in the descriptions: numbered from one, of the right variability, one message."""

import shutil
from functools import cache

import pytest
from any_fmu import KINDS
from every_component import IN_LOOPS
from lxml import etree
from small_fmus import edited

from ballscrew.fmus.dependencies import kinds_of
from ballscrew.fmus.description import model_description
from ballscrew.fmus.interface import interface_of
from ballscrew.fmus.reading import read_description
from ballscrew.orchestration.loop import catalogue
from ballscrew.orchestration.loop.catalogue import catalogued_model, fmu_kernel
from ballscrew.solver.codegen import generate
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
TANGENTS = "pid_variational"
FIRST = "plant", "pid_sampled", "pid_sampled_loop"
PARTS = [
    n if n in FIRST else pytest.param(n, marks=pytest.mark.ci)
    for n in (*catalogue.NAMES, *LOOPS, TANGENTS)
]


@cache
def kernel_of(name):
    if name == TANGENTS:
        return fmu_kernel("pid", tangents=1)
    return fmu_kernel(LOOPS[name], "plant") if name in LOOPS else fmu_kernel(name)


@cache
def described(name, kind):
    """Root of the model description."""
    if kind == "readable":
        return root_of(kernel_of(name))
    if name == TANGENTS:
        model = catalogued_model("pid", tangents=1)
    else:
        model = catalogued_model(LOOPS.get(name, name), "plant" if name in LOOPS else "")
    kinds = kinds_of(model.partials, model.entries)
    given = model.kernel, model.interface, int(kind[-1]), "t", kinds, model.exchanges
    return etree.fromstring(model_description(*given))


def root_of(kernel):
    return etree.fromstring(model_description(kernel, interface_of(kernel), 2, "t"))


@pytest.mark.parametrize("name", PARTS)
def test_value_references_count_the_variables_from_one(name):
    """OMSimulator's FMI 3 import takes them for indices."""
    counted = []
    for kind in KINDS:
        root = described(name, kind)
        variables = list(root.find("ModelVariables"))
        references = [int(v.get("valueReference")) for v in variables]
        assert references == list(range(1, len(references) + 1))
        counted.append([v.get("name") for v in variables])
        for v in variables:  # as OMSimulator reads them: the variable of this number
            if v.get("derivative"):
                state = variables[int(v.get("derivative")) - 1].get("name")
                assert v.get("name") == f"der({state})"
        outputs = [v.get("name") for v in variables if v.get("causality") == "output"]
        three = kind == "native-3"
        structure = root.find("ModelStructure")
        listed = structure.iterfind("Output" if three else "Outputs/Unknown")
        key = "valueReference" if three else "index"
        assert [counted[-1][int(u.get(key)) - 1] for u in listed] == outputs
    readable, two, three = counted
    assert two[: len(readable)] == readable
    assert three[: len(two)] == two


# -- what a description calls discrete stays between events; FMI 2.2.7 and 3.0, 2.4.7.4 ---------


def test_the_time_an_input_or_a_state_makes_an_output_of_a_sampled_part_continuous():
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
    variables = root_of(generate(part)).find("ModelVariables")
    said = {v.get("name"): v.get("variability", "continuous")[0] for v in variables}
    assert {n: said[n] for n in values} == {"a": "d", "b": "c", "c": "c", "d": "c", "e": "d"}


# -- the message ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_outputs_are_numbers_and_the_message_is_a_local_string_without_a_start(kind):
    for name in FIRST:
        root = described(name, kind)
        variables = {v.get("name"): v for v in root.find("ModelVariables")}
        outputs = [v for v in variables.values() if v.get("causality") == "output"]
        types = {(v if kind == "native-3" else v[0]).tag for v in outputs}
        assert types == {"Float64" if kind == "native-3" else "Real"}
        message = variables["message"]
        typed = message if kind == "native-3" else message[0]
        assert typed.tag == "String"
        assert [c.tag for c in typed] == []
        assert typed.get("start") is None
        said = [message.get(k) for k in ("causality", "variability", "initial")]
        assert said == ["local", "discrete", "calculated"]
        key = "valueReference" if kind == "native-3" else "index"
        listed = {unknown.get(key) for unknown in root.find("ModelStructure").iter()}
        assert message.get("valueReference") not in listed  # references are indices, too


def test_a_message_that_is_an_output_as_earlier_versions_wrote_it_is_still_read(fmus, tmp_path):
    old = shutil.copy(fmus["plant"], tmp_path / "old.fmu")
    said = 'causality="{}" variability="discrete" initial="{}">\n      <String{} />'
    edited(
        old, (said.format("local", "calculated", ""), said.format("output", "exact", ' start=""'))
    )
    references = [read_description(path).message_reference for path in (fmus["plant"], old)]
    assert references[0] is not None
    assert references[1] == references[0]
