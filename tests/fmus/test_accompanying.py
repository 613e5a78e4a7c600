"""What an engineer and a tool find in an FMU: licence, types, terminals."""

import zipfile
from pathlib import Path

import fmpy
import pytest
from lxml import etree

from ballscrew.fmus.native.export import write_native
from ballscrew.orchestration.loop.catalogue import catalogued_model, fmu

SCHEMAS = Path(fmpy.__file__).parent / "schema"
LAW = ["u", *(f"u_gain_{s}" for s in "xvzi"), *(f"u_ref_{s}" for s in "xvzi"), "u_rate"]


def content(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def sources_only(tmp_path_factory):
    """``sources_only(name, fmi)``: files of a native FMU, which no compiler was needed for."""
    folder = tmp_path_factory.mktemp("native")

    def get(name, fmi):
        path = write_native(catalogued_model(name), folder / "a.fmu", fmi, platforms=()).path
        return content(path)

    return get


def test_licences_are_where_each_version_of_fmi_looks_for_them(sources_only):
    readable, two, three = content(fmu("plant")), sources_only("plant", 2), sources_only("plant", 3)
    for files in (readable, two, three):
        assert files["documentation/licenses/license.txt"].startswith(b"MIT License")
    assert b"MIT" in readable["documentation/licenses/pythonfmu.txt"]


@pytest.mark.parametrize(
    "name",
    ["plant", *(pytest.param(n, marks=pytest.mark.ci) for n in ("plant_classical", "pid_sampled"))],
)
def test_terminals_are_valid_and_their_members_are_variables(sources_only, name):
    files = sources_only(name, 3)
    root = etree.fromstring(files["terminalsAndIcons/terminalsAndIcons.xml"])
    etree.XMLSchema(file=str(SCHEMAS / "fmi3" / "fmi3TerminalsAndIcons.xsd")).assertValid(root)
    described = etree.fromstring(files["modelDescription.xml"])
    causality = {v.get("name"): v.get("causality") for v in described.find("ModelVariables")}
    members = {t.get("name"): [m.get("variableName") for m in t] for t in root.iter("Terminal")}
    command = "input" if name.startswith("plant") else "output"
    other = {"input": "output", "output": "input"}[command]
    assert {causality[m] for m in members["command"]} == {command}
    assert {causality[m] for m in members["measurement"]} == {other}
    if name != "plant_classical":
        assert members["command"] == LAW
        assert members["measurement"] == list("xvzi")
