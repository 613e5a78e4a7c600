"""Parameters that are Strings or of an Enumeration: by .ssv and by --set."""

import textwrap
import zipfile

import pytest
from networks_of_parts import SSD
from pythonfmu.builder import FmuBuilder

from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import SystemLoop

WORDED = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class Worded(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.law, self.sign = 0.0, "none", 1
        self.register_variable(Real("x", causality=Fmi2Causality.input))
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(String("law", **fixed))
        self.register_variable(Integer("sign", **fixed))
        self.register_variable(
            Real("u", causality=Fmi2Causality.output, getter=lambda: self.gain() * (0.05 - self.x))
        )

    def gain(self):
        return {"none": 0.0, "weak": 100.0, "as strong": 200.0}[self.law] * (-1.0) ** self.sign

    def do_step(self, current_time, step_size):
        return True
"""
# what pythonfmu cannot write
ENUMERATION = """<TypeDefinitions><SimpleType name="Sign"><Enumeration>
<Item name="minus" value="1"/><Item name="plus" value="2"/></Enumeration></SimpleType>
</TypeDefinitions><ModelVariables>"""
VALUES = """<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{values}</ssv:Parameters>
</ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"""


@pytest.fixture(scope="module")
def worded(tmp_path_factory):
    """An FMU u = gain (0.05 - x), whose gain has a name and whose sign is of an enumeration."""
    folder = tmp_path_factory.mktemp("worded")
    (folder / "worded.py").write_text(textwrap.dedent(WORDED))
    FmuBuilder.build_FMU(folder / "worded.py", dest=folder / "Worded.fmu")
    with zipfile.ZipFile(folder / "Worded.fmu") as old:
        files = {name: old.read(name) for name in old.namelist()}
    text = files["modelDescription.xml"].decode()
    head, _, rest = text.partition('name="sign"')
    rest = rest.replace("<Integer", '<Enumeration declaredType="Sign"', 1)
    changed = (head + 'name="sign"' + rest).replace("<ModelVariables>", ENUMERATION)
    files["modelDescription.xml"] = changed.encode()
    with zipfile.ZipFile(folder / "Worded.fmu", "w") as new:
        for name, data in files.items():
            new.writestr(name, data)
    return folder / "Worded.fmu"


def system(path, worded, values=""):
    elements = '<ssd:Component name="axis" source="resources/axis.fmu"/>'
    elements += f'<ssd:Component name="ctl" source="resources/ctl.fmu">{values}</ssd:Component>'
    ends = ("axis", "x", "ctl", "x"), ("ctl", "u", "axis", "u")
    wires = "".join(
        f'<ssd:Connection startElement="{a}" startConnector="{x}" endElement="{b}" '
        f'endConnector="{y}"/>'
        for a, x, b, y in ends
    )
    with zipfile.ZipFile(path, "w") as archive:
        ssd = SSD.format(inputs="", elements=elements, connections=wires)
        archive.writestr("SystemStructure.ssd", ssd)
        archive.write(fmu("plant"), "resources/axis.fmu")
        archive.write(worded, "resources/ctl.fmu")
    return path


def first_command(path, **more):
    run = run_closed_loop(SystemLoop(path, stop=0.002, step=1e-3, **more)).run
    return float(run.commands["u"][0])


@pytest.mark.ci
def test_a_parameter_set_gives_a_text_and_an_item_by_its_name(worded, tmp_path):
    values = VALUES.format(
        values='<ssv:Parameter name="law"><ssv:String value="as strong"/></ssv:Parameter>'
        '<ssv:Parameter name="sign"><ssv:Enumeration value="plus"/></ssv:Parameter>'
    )
    path = system(tmp_path / "set.ssp", worded, values)
    assert first_command(path) == pytest.approx(200.0 * 0.05)
    assert first_command(path, isolate=False) == pytest.approx(200.0 * 0.05)
    told = {"ctl.law": "weak", "ctl.sign": "minus"}
    assert first_command(path, values=told) == pytest.approx(-100.0 * 0.05)
    assert first_command(path, values={"ctl.sign": 1}) == pytest.approx(-200.0 * 0.05)
