"""What an engineer and a tool find in an FMU: page, licence, icon, types, nominals, terminals."""

import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import browser
import fmpy
import pytest
from every_component import EVERY_COMPONENT
from lxml import etree

from ballscrew.fmus.catalogue import fmu, fmu_kernel
from ballscrew.fmus.documentation import html_page
from ballscrew.fmus.interface import interface_of
from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import catalogued_model

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


# -- files -----------------------------------------------------------------------------------


def test_the_licences_are_inside(sources_only):
    for files in (content(fmu("plant")), sources_only("plant", 2), sources_only("plant", 3)):
        assert files["documentation/licenses/license.txt"].startswith(b"MIT License")
    assert b"MIT" in content(fmu("plant"))["documentation/licenses/pythonfmu.txt"]


@pytest.mark.parametrize("name", ["plant", "nctf"])
def test_there_is_an_icon_where_each_version_of_fmi_looks_for_it(sources_only, name):
    pictures = [
        content(fmu(name))["model.png"],
        sources_only(name, 2)["model.png"],
        sources_only(name, 3)["terminalsAndIcons/icon.png"],
    ]
    assert len(set(pictures)) == 1
    assert pictures[0].startswith(b"\x89PNG\r\n\x1a\n")
    assert min(struct.unpack(">II", pictures[0][16:24])) >= 100
    assert len(pictures[0]) < 3000
    assert sources_only("plant", 2)["model.png"] != sources_only("nctf", 2)["model.png"]


# -- terminals -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["plant", "plant_classical", "iol", "pid_sampled"])
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
    gains = {m[len("u_gain_") :] for m in members["command"] if m.startswith("u_gain_")}
    references = {m[len("u_ref_") :] for m in members["command"] if m.startswith("u_ref_")}
    assert gains == references == set(members["measurement"])


# -- types and nominal values ----------------------------------------------------------------


@pytest.mark.parametrize("fmi", [2, 3])
def test_lengths_and_speeds_are_shown_in_the_units_that_people_read_them_in(sources_only, fmi):
    root = etree.fromstring(sources_only("plant", fmi)["modelDescription.xml"])
    factors = {
        (u.get("name"), d.get("name")): float(d.get("factor"))
        for u in root.find("UnitDefinitions")
        for d in u.iter("DisplayUnit")
    }
    assert factors == {("m", "mm"): 1e3, ("m", "um"): 1e6, ("m/s", "mm/s"): 1e3}
    types = {
        t.get("name"): (t if fmi == 3 else t[0]).get("displayUnit")
        for t in root.find("TypeDefinitions")
    }
    shown = {
        v.get("name"): types.get((v if fmi == 3 else v[0]).get("declaredType"))
        for v in root.find("ModelVariables")
    }
    wanted = {"x": "mm", "x_start": "mm", "u_ref_x": "mm", "v": "mm/s", "Vs": "mm/s"}
    wanted |= {"z": "um", "z_start": "um", "u_ref_z": "um", "u": None, "i": None, "m": None}
    assert {n: shown[n] for n in wanted} == wanted


def test_nominal_values_fit():
    variables = {v.name: v for v in interface_of(fmu_kernel("plant"), "plant").variables}
    assert variables["Jm"].nominal == 4.2e-7
    for signal in "xvzi":
        assert variables[f"{signal}_start"].nominal == variables[signal].nominal


# -- the page --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_formulas_are_well_formed_and_hold_no_names_of_functions_of_sympy(name):
    for row in fmu_kernel(name).equations:
        for cell in row:
            tree = etree.fromstring(f"<math>{cell}</math>")
            words = {"".join(e.itertext()) for e in tree.iter("mi")}
            assert not words & {"piecewise", "ite", "Piecewise", "ITE", "ExprCondPair"}


def test_what_a_user_s_component_says_does_not_become_part_of_the_page():
    kernel = replace(fmu_kernel("plant"), description="<script>alert(1)</script> & more")
    page = html_page(kernel, interface_of(kernel, "plant"))
    assert "<p>&lt;script&gt;alert(1)&lt;/script&gt; &amp; more.</p>" in page
    assert "<script" not in page


@pytest.mark.skipif(browser.PROGRAM is None, reason="no chromium here: apt-get install chromium")
@pytest.mark.parametrize("name", ["plant", "iol", "plant_maxwell_slip", "plant_classical"])
def test_in_a_browser_no_formula_is_wider_than_the_page(name, tmp_path):
    page = tmp_path / "index.html"
    kernel = fmu_kernel(name)
    page.write_text(html_page(kernel, interface_of(kernel, name)))
    with browser.opened(page, width=1000, height=800) as opened:
        assert opened.errors == []
        right = "[...document.querySelectorAll('math')].map(m => m.getBoundingClientRect().right)"
        edges = opened.evaluate(right)
        assert len(edges) > 50
        assert max(edges) <= 1000
        # MathML is drawn, not shown as text: what is above a line stands above what is below it
        parts = "[...document.querySelector('mfrac').children].map(p => p.getBoundingClientRect())"
        assert opened.evaluate(f"(([up, down]) => up.bottom <= down.top + 2)({parts})")
