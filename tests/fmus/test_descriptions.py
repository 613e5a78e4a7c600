"""What descriptions of FMUs say: variables, the message, terminals, licences, units."""

import shutil
import zipfile
from pathlib import Path

import fmpy
import pytest
from any_fmu import KINDS
from every_component import EVERY_COMPONENT
from fmpy.validation import validate_fmu
from lxml import etree
from small_fmus import edited

from ballscrew import TIME, Component, DiscreteState, Input, Output, Parameter, State, symbol
from ballscrew.fmus.reading import read_description
from ballscrew.fmus.units import base_exponents
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.errors import FmuError

SCHEMAS = Path(fmpy.__file__).parent / "schema"
LAW = ["u", *(f"u_gain_{s}" for s in "xvzi"), *(f"u_ref_{s}" for s in "xvzi"), "u_rate"]
FIELDS = "valueReference causality variability unit min max nominal start description"


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_every_kind_is_valid_and_has_the_same_variables_counted_from_one(made, name):
    """OMSimulator's FMI 3 import takes value references for indices."""
    tables = []
    for kind in KINDS:
        path = made(name, kind)
        assert validate_fmu(str(path)) == []
        assert kind == "readable" or path.stat().st_size < 105_000
        described = fmpy.read_model_description(str(path))
        variables = described.modelVariables
        assert [v.valueReference for v in variables] == [*range(1, len(variables) + 1)]
        assert all(v.name == f"der({v.derivative.name})" for v in variables if v.derivative)
        outputs = [v for v in variables if v.causality == "output"]
        assert [u.variable for u in described.outputs] == outputs
        assert {v.type for v in outputs} <= {"Float64" if kind == "native-3" else "Real"}
        (message,) = (v for v in variables if v.name == "message")
        said = [message.type, message.causality, message.variability, message.initial]
        assert [*said, message.start] == ["String", "local", "discrete", "calculated", None]
        tables.append({v.name: [getattr(v, f) for f in FIELDS.split()] for v in variables})
    readable, two, three = tables
    assert {n: two[n] for n in readable} == readable
    assert len({n for n in two if n.startswith("der(")}) == len(fmu_kernel(name).states)
    assert {n: three[n] for n in two} == two
    more = {n for n in three if n not in two and not n.startswith("event_indicator_")}
    assert more == {"time"}


def test_the_time_an_input_or_a_state_makes_an_output_of_a_sampled_part_continuous(written):
    """What a description calls discrete stays between events; FMI 2.2.7 and 3.0, 2.4.7.4."""
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
    variables = fmpy.read_model_description(str(written(part, "readable"))).modelVariables
    said = {v.name: v.variability[0] for v in variables if v.name in values}
    assert said == {"a": "d", "b": "c", "c": "c", "d": "c", "e": "d"}


def test_a_message_that_is_an_output_as_earlier_versions_wrote_it_is_still_read(fmus, tmp_path):
    old = shutil.copy(fmus["plant"], tmp_path / "old.fmu")
    said = 'causality="{}" variability="discrete" initial="{}">\n      <String{} />'
    edited(
        old, (said.format("local", "calculated", ""), said.format("output", "exact", ' start=""'))
    )
    references = [read_description(path).message_reference for path in (fmus["plant"], old)]
    assert references[0] is not None
    assert references[1] == references[0]


# -- what else is in an FMU ------------------------------------------------------------------------


def content(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_licences_are_where_each_version_of_fmi_looks_for_them(made):
    for kind in KINDS:
        files = content(made("plant", kind))
        assert files["documentation/licenses/license.txt"].startswith(b"MIT License")
        assert kind != "readable" or b"MIT" in files["documentation/licenses/pythonfmu.txt"]


@pytest.mark.parametrize(
    "name",
    ["plant", *(pytest.param(n, marks=pytest.mark.ci) for n in ("plant_classical", "pid_sampled"))],
)
def test_terminals_are_valid_and_their_members_are_variables(made, name):
    files = content(made(name, "native-3"))
    root = etree.fromstring(files["terminalsAndIcons/terminalsAndIcons.xml"])
    etree.XMLSchema(file=str(SCHEMAS / "fmi3" / "fmi3TerminalsAndIcons.xsd")).assertValid(root)
    described = etree.fromstring(files["modelDescription.xml"])
    causality = {v.get("name"): v.get("causality") for v in described.find("ModelVariables")}
    members = {t.get("name"): [m.get("variableName") for m in t] for t in root.iter("Terminal")}
    ways = ("input", "output") if name.startswith("plant") else ("output", "input")
    for terminal, way in zip(("command", "measurement"), ways, strict=True):
        assert {causality[m] for m in members[terminal]} == {way}
    if name != "plant_classical":
        assert members["command"] == LAW
        assert members["measurement"] == list("xvzi")


# -- units -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("N*s/m", {"kg": 1, "s": -1}),
        ("V/(m/s)", {"kg": 1, "m": 1, "s": -2, "A": -1}),
        ("kg*m^2", {"kg": 1, "m": 2}),
        ("N*m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    ],
)
def test_known_units(unit, exponents):
    assert base_exponents(unit) == exponents


@pytest.mark.ci
def test_other_strings_are_refused_with_the_string_in_the_message():
    wrong = "furlong N* m/(s m^x m% m) m^1234567 2*m m^2^2".split()
    for unit in ("", *wrong, 90 * "(", 200 * "m"):
        with pytest.raises(FmuError) as refused:
            base_exponents(unit)
        assert repr(unit) in str(refused.value)
