"""Closed loops as one .ssp: by the standard, in another reader, and run."""

import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import fmpy
import fmpy.ssp
import pytest
from any_fmu import repacked
from every_component import EVERY_CONTROLLER
from lxml import etree

from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop import catalogue
from ballscrew.solver.errors import FmuError

SCHEMAS = Path(fmpy.ssp.__file__).with_name("schema")
SPACES = {
    prefix: f"http://ssp-standard.org/SSP1/SystemStructure{part}"
    for prefix, part in (("ssc", "Common"), ("ssd", "Description"), ("ssv", "ParameterValues"))
}
LAW = ["u", "u_rate", *(f"u_{part}_{s}" for part in ("gain", "ref") for s in "xvzi")]
BETWEEN = ["position_encoder", "velocity_estimate"]


@pytest.fixture(scope="module")
def system(fmus, tmp_path_factory):
    """``system(controller)`` is the path of a system, made when it is asked for."""
    folder = tmp_path_factory.mktemp("systems")
    return cache(
        lambda name: export_system(fmus["plant"], fmus[name], folder / f"{name}.ssp", name=name)
    )


@pytest.fixture(scope="module")
def measured_system(fmus, tmp_path_factory):
    """The sampled NCTF loop, position and velocity through instruments."""
    controller = catalogue.component("nctf+sampled")
    fast = replace(controller.sample_time, default=5e-5)
    return export_system(
        fmus["plant"],
        catalogue.fmu(replace(controller, sample_time=fast)),
        tmp_path_factory.mktemp("measured") / "nctf_sampled.ssp",
        name="nctf_sampled",
        instruments={name: fmus[name] for name in BETWEEN},
    )


def read_xml(path, name="SystemStructure.ssd"):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read(name))


def check_by_schemas(path, elements):
    sets = [(f"resources/{n}.ssv", "SystemStructureParameterValues.xsd") for n in elements]
    for file, schema in (("SystemStructure.ssd", "SystemStructureDescription.xsd"), *sets):
        etree.XMLSchema(file=str(SCHEMAS / schema)).assertValid(read_xml(path, file))


def connections(path):
    keys = "startElement", "startConnector", "endElement", "endConnector"
    nodes = read_xml(path).iterfind(".//ssd:Connection", SPACES)
    return {tuple(node.get(key) for key in keys) for node in nodes}


# by the standard


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_a_system_is_valid_and_has_the_ports_parameters_and_units_of_its_fmus(system, fmus, name):
    path = system(name)
    check_by_schemas(path, ["plant", "controller"])
    wanted = {("plant", s, "controller", s) for s in "xvzi"}
    assert connections(path) == wanted | {("controller", p, "plant", p) for p in LAW}
    for element, fmu in (("plant", fmus["plant"]), ("controller", fmus[name])):
        variables = fmpy.read_model_description(str(fmu)).modelVariables
        real = {v.name: v for v in variables if v.type == "Real"}
        component = read_xml(path).find(f".//ssd:Component[@name='{element}']", SPACES)
        connectors = {
            c.get("name"): (c.get("kind"), c.find("ssc:Real", SPACES).get("unit"))
            for c in component.iterfind(".//ssd:Connector", SPACES)
        }
        assert connectors == {n: (v.causality, v.unit) for n, v in real.items()}
        found = read_xml(path, f"resources/{element}.ssv").iterfind(".//ssv:Parameter", SPACES)
        values = {p.get("name"): dict(p.find("ssv:Real", SPACES).attrib) for p in found}
        own = [v for v in real.values() if v.causality == "parameter"]
        defaults = {v.name: {"value": v.start, "unit": v.unit} for v in own}
        if element == "controller":
            goals = {"x_d": ("0.08", "m"), "v_d": ("0.0", "m/s"), "a_d": ("0.0", "m/s^2")}
            defaults |= {n: {"value": v, "unit": u} for n, (v, u) in goals.items() if n in real}
        assert values == defaults


def test_omsimulator_finds_its_master_where_it_looks_for_it(system):
    """Without it, its executable ends with "[NewSystem] internal error"."""
    oms = "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}"
    (annotation,) = read_xml(system("nctf")).iterfind(
        "ssd:System/ssd:Annotations/ssc:Annotation", SPACES
    )
    assert annotation.get("type") == "org.openmodelica"
    (master,) = annotation.iterfind(f"{oms}Annotations/{oms}SimulationInformation/*")
    assert (master.tag, master.get("description")) == (oms + "FixedStepMaster", "oms-ma")
    # it hands this on to the FMUs, whose solvers take it for their own
    assert (master.get("stepSize"), master.get("relativeTolerance")) == ("0.0002", "1e-08")
    # it looks for the elements by these letters
    with zipfile.ZipFile(system("nctf")) as archive:
        assert b"<oms:FixedStepMaster" in archive.read("SystemStructure.ssd")


def test_instruments_stand_between_and_sample_with_a_sampled_controller(measured_system):
    check_by_schemas(measured_system, ["plant", *BETWEEN, "controller"])
    wanted = {("plant", s, "controller", s) for s in "zi"} | {
        ("plant", "x", "position_encoder", "x"),
        ("position_encoder", "x_measured", "velocity_estimate", "x"),
        ("position_encoder", "x_measured", "controller", "x"),
        ("velocity_estimate", "v_measured", "controller", "v"),
    }
    # the law acts on what the controller measures at the plant itself
    law = {"u", "u_rate", *(f"u_{part}_{s}" for part in ("gain", "ref") for s in "zi")}
    wanted |= {("controller", p, "plant", p) for p in law}
    assert connections(measured_system) == wanted
    (period,) = read_xml(measured_system, "resources/velocity_estimate.ssv").iterfind(
        ".//ssv:Parameter[@name='sample_time']/ssv:Real", SPACES
    )
    assert float(period.get("value")) == 5e-5


# what makes no system


def without(source, target, *names):
    """A copy of an FMU whose description does not mention some variables."""

    def change(name, data):
        if name != "modelDescription.xml":
            return data
        root = etree.fromstring(data)
        variables = root.find("ModelVariables")
        for variable in [v for v in variables if v.get("name") in names]:
            variables.remove(variable)
        root.remove(root.find("ModelStructure"))
        return etree.tostring(root)

    return repacked(source, target, change)


def test_sides_that_do_not_meet_are_refused_with_one_line(fmus, tmp_path):
    path = tmp_path / "loop.ssp"
    plant, nctf = fmus["plant"], fmus["nctf"]
    silent = without(fmus["pid"], tmp_path / "silent.fmu", "u")
    for said, sides, options in (
        (r"its inputs do not fit the outputs of .*: its inputs are x, v", (nctf, nctf), {}),
        ("the set-point is nan", (plant, nctf), {"setpoint": float("nan")}),
        (r"the stop time is 0\.0 s", (plant, nctf), {"stop": 0.0}),
        (r"nothing is connected to the input 'u' of .*plant", (plant, silent), {}),
    ):
        with pytest.raises(FmuError, match=said):
            export_system(*sides, path, name="a", **options)
    with pytest.raises(FmuError, match="no such file"):
        export_system(plant, tmp_path / "gone.fmu", path, name="a")
    assert not path.exists()


def test_a_gain_is_left_out_where_its_reference_is_missing(fmus, tmp_path):
    """Alone it would multiply the whole signal, not the change since the command was computed."""
    partial = without(fmus["pid"], tmp_path / "partial.fmu", "u_ref_x", "u_gain_v")
    path = export_system(fmus["plant"], partial, tmp_path / "partial.ssp", name="partial")
    connected = {port for element, port, *_ in connections(path) if element == "controller"}
    assert connected == set(LAW) - {"u_ref_x", "u_gain_x", "u_ref_v", "u_gain_v"}


def test_instruments_that_fit_nowhere_are_refused_with_one_line(fmus, tmp_path):
    inputs = fmpy.read_model_description(str(fmus["plant"])).modelVariables
    silent = without(
        fmus["plant"], tmp_path / "silent.fmu", *(v.name for v in inputs if v.causality == "input")
    )
    blind = without(fmus["nctf"], tmp_path / "blind.fmu", "i")
    for said, controller, instruments in (
        ("nothing is connected to the input 'x_d' of ", fmus["nctf"], {"other": fmus["pid"]}),
        ("output 'x' does not say what it measures", fmus["nctf"], {"other": silent}),
        ("an instrument is called 'plant'", fmus["nctf"], {"plant": fmus["position_encoder"]}),
        (
            "nothing is connected to the outputs i_measured of ",
            blind,
            {"sensor": fmus["current_sensor"]},
        ),
    ):
        with pytest.raises(FmuError, match=said):
            export_system(
                fmus["plant"], controller, tmp_path / "a.ssp", name="a", instruments=instruments
            )


# another reader


@pytest.mark.ci
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pyssp_standard_opens_it_and_finds_nothing_to_complain_of(
    system, native, tmp_path, version
):
    """FMUs of FMI 3 make an SSP 2.0."""
    pyssp = pytest.importorskip("pyssp_standard.ssp", reason="needs pyssp_standard")
    path = system("nctf")
    if version == "2.0":
        path = export_system(native("plant", 3), native("pid", 3), tmp_path / "3.ssp", name="3")
    with pyssp.SSP(path, mode="r") as found:
        with found.system_structure as ssd:
            assert ssd.version == version
            ssd.__check_compliance__()
            assert ssd.check_connections(connector_not_in_system=True) == []
            assert len(ssd.connections()) == 14
        for parameters in found.ssv:
            parameters.__check_compliance__()
        assert len(found.resources) == 4
