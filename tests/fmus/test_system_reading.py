"""Systems (.ssp) as others write them: nested, scaled, in other units, broken, hostile."""

import io
import tempfile
import zipfile
from pathlib import Path

import pytest

from ballscrew.fmus.system_network import SystemConnection, SystemPort
from ballscrew.fmus.system_reading import read_system
from ballscrew.solver.errors import FmuError

STANDARD = "http://ssp-standard.org/SSP1/SystemStructure"
SPACES = {
    "ssc": "Common",
    "ssd": "Description",
    "ssm": "ParameterMapping",
    "ssv": "ParameterValues",
}
UNITS = """
  <ssd:Units>
    <ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
    <ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
    <ssc:Unit name="N"><ssc:BaseUnit kg="1" m="1" s="-2"/></ssc:Unit>
    <ssc:Unit name="K"><ssc:BaseUnit K="1"/></ssc:Unit>
    <ssc:Unit name="degC"><ssc:BaseUnit K="1" offset="273.15"/></ssc:Unit>
  </ssd:Units>"""
FMU_UNITS = """
  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
  </UnitDefinitions>"""


def an_fmu(*variables, version="2.0"):
    """An FMU that can only say what it has: ``input Real x m`` or ``parameter Integer n``."""
    lines = []
    for k, text in enumerate(variables):
        causality, kind, name, *unit = text.split()
        attributes = f' unit="{unit[0]}"' if unit else ""
        start = "" if causality == "output" else ' start="0"'
        variability = "fixed" if causality == "parameter" else "discrete"
        lines.append(
            f'<ScalarVariable name="{name}" valueReference="{k}" causality="{causality}" '
            f'variability="{variability}"><{kind}{attributes}{start}/></ScalarVariable>'
        )
    return f"""<?xml version="1.0"?>
<fmiModelDescription fmiVersion="{version}" modelName="m" guid="g"
    modelIdentifier="m" numberOfContinuousStates="0" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="m"/>{FMU_UNITS}
  <ModelVariables>{"".join(lines)}</ModelVariables>
  <ModelStructure/>
</fmiModelDescription>"""


TWO = {
    "resources/a.fmu": an_fmu(
        "output Real y m",
        "input Real x m",
        "parameter Real gain",
        "parameter Integer n",
        "parameter Boolean on",
        "parameter String file",
        "output Integer count",
        "output String words",
    ),
    "resources/b.fmu": an_fmu("input Real x", "output Real y", "parameter Real length m"),
}
ELEMENTS = """
    <ssd:Elements>
      <ssd:Component name="a" source="resources/a.fmu"/>
      <ssd:Component name="b" source="resources/b.fmu"/>
    </ssd:Elements>"""


def described(system, *, version="1.0", rest=UNITS, prolog=""):
    spaces = " ".join(f'xmlns:{prefix}="{STANDARD}{part}"' for prefix, part in SPACES.items())
    return f"""<?xml version="1.0" encoding="UTF-8"?>{prolog}
<ssd:SystemStructureDescription {spaces} version="{version}" name="rig">
  <ssd:System name="top">{system}
  </ssd:System>{rest}
</ssd:SystemStructureDescription>"""


def packed(path, system, files=None, **options):
    """Write an .ssp; `system` is the inside of its System, or None for no description at all."""
    files = dict(TWO if files is None else files)
    if system is not None:
        files["SystemStructure.ssd"] = described(system, **options)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            if name.endswith(".fmu"):
                stream = io.BytesIO()
                with zipfile.ZipFile(stream, "w") as inner:
                    inner.writestr("modelDescription.xml", content)
                content = stream.getvalue()
            archive.writestr(name, content)
    return path


@pytest.fixture(autouse=True)
def a_temporary_folder_of_its_own(tmp_path, monkeypatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))


@pytest.fixture
def read(tmp_path):
    """Write an .ssp and read it; its folder is removed when the test is over."""
    kept = []

    def run(system, files=None, **options):
        kept.append(read_system(packed(tmp_path / "system.ssp", system, files, **options)))
        return kept[-1]

    yield run
    for system in kept:
        system.remove()


def connected(inside="", start="a.y", end="b.x", attributes="", before=""):
    (from_element, from_port), (to_element, to_port) = (
        name.rpartition(".")[::2] for name in (start, end)
    )
    ends = [
        f'{which}Element="{element}"'
        for which, element in (("start", from_element), ("end", to_element))
        if element
    ]
    return f"""{before}{ELEMENTS}
    <ssd:Connections>
      <ssd:Connection {" ".join(ends)} startConnector="{from_port}" endConnector="{to_port}"
                      {attributes}>{inside}</ssd:Connection>
    </ssd:Connections>"""


def parameters(content, attributes="", mapping=""):
    return f"""
    <ssd:ParameterBindings><ssd:ParameterBinding {attributes}>
      <ssd:ParameterValues><ssv:ParameterSet version="1.0" name="set">
        <ssv:Parameters>{content}</ssv:Parameters>
      </ssv:ParameterSet></ssd:ParameterValues>{mapping}
    </ssd:ParameterBinding></ssd:ParameterBindings>"""


def typed(name, inside):
    return f'<ssv:Parameter name="{name}">{inside}</ssv:Parameter>'


def real(name, value, unit=""):
    unit = f' unit="{unit}"' if unit else ""
    return typed(name, f'<ssv:Real value="{value}"{unit}/>')


def values(system, element):
    return {e.name: e.start_values for e in system.elements}[element]


# what is read


NESTED = """
    <ssd:Connectors>
      <ssd:Connector name="goal" kind="input"><ssc:Real unit="mm"/></ssd:Connector>
      <ssd:Connector name="seen" kind="output"><ssc:Real unit="degC"/></ssd:Connector>
    </ssd:Connectors>
    <ssd:ParameterBindings><ssd:ParameterBinding source="start.ssv" prefix="inner."/>
    </ssd:ParameterBindings>
    <ssd:Elements>
      <ssd:Component name="a" source="resources/a.fmu"/>
      <ssd:System name="inner">
        <ssd:Connectors>
          <ssd:Connector name="in" kind="input"/>
          <ssd:Connector name="size" kind="parameter"><ssc:Real unit="mm"/></ssd:Connector>
          <ssd:Connector name="out" kind="output"><ssc:Real unit="K"/></ssd:Connector>
        </ssd:Connectors>
        <ssd:Elements>
          <ssd:Component name="b" source="resources/b.fmu" type="application/x-fmu-sharedlibrary">
            <ssd:Connectors>
              <ssd:Connector name="x" kind="input"><ssc:Real unit="mm"/></ssd:Connector>
              <ssd:Connector name="y" kind="output"><ssc:Real unit="degC"/></ssd:Connector>
            </ssd:Connectors>
          </ssd:Component>
        </ssd:Elements>
        <ssd:Connections>
          <ssd:Connection startConnector="in" endElement="b" endConnector="x">
            <ssc:LinearTransformation factor="2" offset="5"/>
          </ssd:Connection>
          <ssd:Connection startConnector="size" endElement="b" endConnector="length"/>
          <ssd:Connection startElement="b" startConnector="y" endConnector="out"/>
        </ssd:Connections>
      </ssd:System>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startConnector="goal" endElement="a" endConnector="x"/>
      <ssd:Connection startElement="a" startConnector="y" endElement="inner" endConnector="in"/>
      <ssd:Connection startConnector="seen" endElement="inner" endConnector="out"/>
    </ssd:Connections>"""
START = f"""<v:ParameterSet xmlns:v="{STANDARD}ParameterValues" version="1.0" name="start">
  <v:Parameters>
    <v:Parameter name="size"><v:Real value="250"/></v:Parameter>
    <v:Parameter name="b.x"><v:Real value="7"/></v:Parameter>
  </v:Parameters>
</v:ParameterSet>"""


def test_a_nested_system_of_a_stranger_is_flattened_with_units_and_transformations(read):
    system = read(
        NESTED,
        TWO | {"start.ssv": START},
        rest=UNITS + '<ssd:DefaultExperiment startTime="1" stopTime="3.5"/>',
    )
    assert [e.name for e in system.elements] == ["a", "inner.b"]
    assert (system.start, system.stop) == (1.0, 3.5)
    # metres to millimetres, then the transformation
    assert system.connections == (
        SystemConnection(SystemPort("a", "y"), SystemPort("inner.b", "x"), 2000.0, 5.0),
    )
    (goal,) = system.inputs
    assert (goal.name, goal.unit, goal.start) == ("goal", "mm", None)
    assert goal.drives == (
        SystemConnection(SystemPort("", "goal"), SystemPort("a", "x"), 0.001, 0.0),
    )
    # degrees to kelvin and back, and the connection is written from its far end
    (seen,) = system.outputs
    assert (seen.name, seen.unit) == ("seen", "degC")
    assert seen.driven_by.source == SystemPort("inner.b", "y")
    assert (seen.driven_by.factor, seen.driven_by.offset) == (1.0, 0.0)
    # the parameter goes through the inner system's connector, 250 mm
    assert values(system, "inner.b") == {"length": 0.25, "x": 7.0}


def test_ssp_2_0_is_read_with_its_own_names_of_types(read):
    connectors = """<ssd:Connectors>
      <ssd:Connector name="goal" kind="input"><ssc:Float64 unit="m"/></ssd:Connector>
    </ssd:Connectors>"""
    system = read(connected(start="goal", end="a.x", before=connectors), version="2.0")
    assert [str(c.target) for c in system.inputs[0].drives] == ["a.x"]


def test_units_are_not_converted_where_the_connection_forbids_it(read):
    files = TWO | {"resources/b.fmu": an_fmu("input Real x mm")}
    system = read(connected(attributes='suppressUnitConversion="true"'), files)
    assert system.connections[0].factor == 1.0


def test_a_later_parameter_binding_and_an_outer_one_have_the_last_word(read):
    inner = parameters(real("gain", 1) + real("x", 1))
    later = parameters(real("x", 2)).replace("<ssd:ParameterBindings>", "")
    both = inner.replace("</ssd:ParameterBindings>", "") + later
    elements = f"""<ssd:Elements>
      <ssd:Component name="a" source="resources/a.fmu">{both}</ssd:Component></ssd:Elements>"""
    system = read(parameters(real("a.gain", 3)) + elements)
    assert values(system, "a") == {"gain": 3.0, "x": 2.0}


def test_a_parameter_mapping_renames_converts_and_scales(read):
    mapping = """<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">
      <ssm:MappingEntry source="p.l" target="a.x">
        <ssc:LinearTransformation factor="2" offset="1"/></ssm:MappingEntry>
      <ssm:MappingEntry source="p.l" target="b.length"/>
      <ssm:MappingEntry source="p.gone" target="b.x"/>
    </ssm:ParameterMapping></ssd:ParameterMapping>"""
    content = real("l", 500, "mm") + real("other", 1)
    system = read(parameters(content, 'prefix="p."', mapping) + ELEMENTS)
    assert values(system, "a") == {"x": 2.0}  # 500 mm = 0.5 m
    assert values(system, "b") == {"length": 500.0 * 0.001}
    assert len(system.ignored) == 2
    assert all(any(name in text for text in system.ignored) for name in ("p.gone", "p.other"))


def test_integers_booleans_and_texts_keep_their_kind(read):
    content = "".join(
        typed(f"a.{name}", f'<ssv:{kind} value="{value}"/>')
        for name, kind, value in (
            ("n", "Integer", 3),
            ("on", "Boolean", "true"),
            ("gain", "Integer", 4),
            ("file", "String", "table 1.csv"),
        )
    )
    found = values(read(parameters(content) + ELEMENTS), "a")
    assert found == {"n": 3, "on": True, "gain": 4.0, "file": "table 1.csv"}
    assert [type(v) for v in found.values()] == [int, bool, float, str]


def test_the_start_of_a_system_s_input_reaches_the_ports_that_it_drives(read):
    connectors = """<ssd:Connectors>
      <ssd:Connector name="goal" kind="input"><ssc:Real unit="mm"/></ssd:Connector>
    </ssd:Connectors>"""
    before = connectors + parameters(real("goal", 80))
    system = read(connected(start="goal", end="a.x", before=before))
    assert (system.inputs[0].start, system.start, system.stop) == (80.0, 0.0, None)
    assert values(system, "a") == {"x": 0.08}


# what is refused


def refusal(tmp_path, system, files=None, **options):
    """The message, which is one line, names the file, and leaves nothing behind."""
    path = packed(tmp_path / "system.ssp", system, files, **options)
    with pytest.raises(FmuError) as caught:
        read_system(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert list(Path(tempfile.gettempdir()).iterdir()) == []
    return text


BOMB = """<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>"""


def test_a_file_that_is_missing_or_no_zip_is_refused(tmp_path):
    with pytest.raises(FmuError, match=r"gone\.ssp: no such file"):
        read_system(tmp_path / "gone.ssp")
    (tmp_path / "text.ssp").write_text("no zip")
    with pytest.raises(FmuError, match=r"text\.ssp: .*not a zip file"):
        read_system(tmp_path / "text.ssp")


def experiment(attributes):
    return {"system": ELEMENTS, "rest": f"<ssd:DefaultExperiment {attributes}/>"}


DEEP = '<ssd:Elements><ssd:System name="s">' * 3 + "</ssd:System></ssd:Elements>" * 3


NO_SYSTEM = [
    ({"system": None}, "holds no SystemStructure.ssd"),
    ({"system": ELEMENTS, "version": "3.0"}, "is SSP version 3.0, expected 1.0 or 2.0"),
    ({"system": "<ssd:Elements>"}, "SystemStructure.ssd is no XML"),
    ({"system": "&b;" + ELEMENTS, "prolog": BOMB}, "declares a document type"),
    ({"system": ""}, "holds no component"),
    (experiment('stopTime="INF"'), "the stop time is 'INF', expected a finite number"),
    (experiment('startTime="2" stopTime="1"'), "stop time 1 s is not after the start time 2 s"),
    ({"system": DEEP}, "system 's.s.s' lies 3 levels deep, expected at most 2"),
]


def test_an_archive_that_climbs_out_or_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    files = TWO | {"../outside.txt": "x"}
    assert "is outside its folder" in refusal(tmp_path, ELEMENTS, files)
    assert not (tmp_path.parent / "outside.txt").exists()
    with monkeypatch.context() as patch:
        patch.setattr("ballscrew.fmus.archive.LARGEST", 1000)
        assert "would unpack to" in refusal(tmp_path, ELEMENTS, TWO | {"zeros": "0" * 2000})
    monkeypatch.setattr("ballscrew.fmus.system_reading.LARGEST_OF_ALL", 100)
    assert "its FMUs would unpack to" in refusal(tmp_path, ELEMENTS)


MANY = """<ssd:Connectors>
  <ssd:Connector name="in" kind="input"><ssc:Real/></ssd:Connector>
  <ssd:Connector name="out" kind="output"><ssc:Real/></ssd:Connector>
  <ssd:Connector name="both" kind="inout"><ssc:Real/></ssd:Connector>
</ssd:Connectors>"""


DICTIONARY = (
    '<ssd:Elements><ssd:SignalDictionaryReference name="bus" dictionary="d"/></ssd:Elements>'
)
SECOND = '<ssd:Connection startConnector="in" endElement="b" endConnector="x"/></ssd:Connections>'
RING = f"""<ssd:Elements><ssd:System name="s">{MANY}<ssd:Connections>
    <ssd:Connection startConnector="in" endConnector="out"/></ssd:Connections></ssd:System>
  </ssd:Elements><ssd:Connections><ssd:Connection startElement="s" startConnector="out"
    endElement="s" endConnector="in"/></ssd:Connections>"""


def goal_in(unit):
    connectors = f"""<ssd:Connectors><ssd:Connector name="g" kind="input"><ssc:Real unit="{unit}"/>
      </ssd:Connector></ssd:Connectors>"""
    return connected(start="g", end="a.x", before=connectors)


def component_of(attributes):
    return f'<ssd:Elements><ssd:Component name="c" {attributes}/></ssd:Elements>'


def with_parameters(content):
    connector = '<ssd:Connector name="on" kind="parameter"/>'
    return f"<ssd:Connectors>{connector}</ssd:Connectors>{parameters(content)}{ELEMENTS}"


REFUSED = [
    *(
        (component_of(attributes), text)
        for attributes, text in (
            ('source="resources/c.fmu"', "which is not in the archive; nearest: resources/"),
            ('source="two&#10;lines.fmu"', "'two\\nlines.fmu', which is not in the archive"),
            ('source="resources/%2e%2e/%2e%2e/a.fmu"', "expected a file in the archive"),
            ('source="file:///etc/passwd"', "expected a file in the archive"),
            ("", "element 'c' has no source"),
            (
                'source="x.ssp" type="application/x-ssp-package"',
                "is of type application/x-ssp-package",
            ),
            ('source="text.fmu"', "text.fmu: modelDescription.xml is no XML"),
            ('source="old.fmu"', "old.fmu: is FMI 1.0, expected FMI 2.0"),
        )
    ),
    *(
        (connected(before=MANY, **connection), text)
        for connection, text in (
            ({"start": "bb.y"}, "names the element 'bb', which does not exist; nearest: b"),
            (
                {"end": "b.xx"},
                "names the connector 'xx' of 'b', which does not exist or is no number; nearest: x",
            ),
            ({"end": "b.y"}, "joins a.y and b.y, which both give a value"),
            ({"start": "both"}, "joins both of kind inout"),
            ({"start": "in", "end": "out"}, "the system's output out is its input in"),
            ({"start": "a.y", "end": "b.length"}, "only outputs and inputs can be connected"),
            ({"attributes": 'suppressUnitConversion="maybe"'}, "expected true or false"),
            ({"inside": '<ssc:LinearTransformation factor="nan"/>'}, "the factor is 'nan'"),
            ({"inside": "<ssc:IntegerMappingTransformation/>"}, "only a LinearTransformation"),
        )
    ),
    (DICTIONARY, "element 'bus' is a SignalDictionaryReference"),
    (ELEMENTS.replace('name="b"', 'name="a"'), "two elements are called 'a'"),
    (
        connected(before=MANY).replace("</ssd:Connections>", SECOND),
        "b.x is driven twice, by a.y and in",
    ),
    (RING, "form a ring"),
    (goal_in("N"), "'N' cannot be converted to 'm': they are units of different quantities"),
    *(
        (with_parameters(content), text)
        for content, text in (
            (real("a.gain", "NaN"), "parameter 'a.gain' is 'NaN', expected a finite number"),
            (real("a.n", 1.5), "is a Real, but a.n is a Integer"),
            (
                typed("a.file", '<ssv:Binary value="00"/>'),
                "only numbers, truth values and texts can",
            ),
            (typed("on", '<ssv:String value="x"/>'), "name the FMU's own parameter"),
            (typed("a.n", ""), "parameter 'a.n' has no value"),
            (real("a.gain", 1) + real("a.gain", 2), "has two values for parameter 'a.gain'"),
        )
    ),
]


@pytest.mark.parametrize(
    ("asked", "text"), [*NO_SYSTEM, *(pytest.param(*r, marks=pytest.mark.ci) for r in REFUSED)]
)
def test_what_is_no_system_or_cannot_be_run_joined_or_set_is_refused(tmp_path, asked, text):
    files = TWO | {"text.fmu": "no XML", "old.fmu": an_fmu(version="1.0")}
    options = asked if isinstance(asked, dict) else {"system": asked}
    assert text in refusal(tmp_path, files=files, **options)
