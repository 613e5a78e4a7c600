"""Closed loops as one .ssp: by the standard, in another reader, and run."""

import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import fmpy.ssp
import numpy as np
import pytest
from every_component import EVERY_CONTROLLER
from lxml import etree

from ballscrew.cli import main
from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop import catalogue
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.solver.errors import FmuError

SCHEMAS = Path(fmpy.ssp.__file__).with_name("schema")
SPACES = {
    prefix: f"http://ssp-standard.org/SSP1/SystemStructure{part}"
    for prefix, part in (("ssc", "Common"), ("ssd", "Description"), ("ssv", "ParameterValues"))
}
LAW = ["u", "u_rate", *(f"u_{part}_{s}" for part in ("gain", "ref") for s in "xvzi")]
BETWEEN = ["position_encoder", "velocity_estimate"]


@pytest.fixture(scope="module")
def systems(fmus, tmp_path_factory):
    """Paths of systems by the controller, each made when it is asked for."""

    class Made(dict):
        def __missing__(self, name):
            path = tmp_path_factory.mktemp("systems") / f"{name}.ssp"
            return self.setdefault(name, export_system(fmus["plant"], fmus[name], path, name=name))

    return Made()


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


@pytest.fixture(scope="module")
def native_system(native, tmp_path_factory):
    """What ``ballscrew export --ssp --native`` writes of the linearizing loop."""
    folder = tmp_path_factory.mktemp("native-system")
    assert main(["export", "--ssp", "--native", "--only", "iol", "--out", str(folder)]) == 0
    assert [p.name for p in folder.iterdir()] == ["iol.ssp"]
    return folder / "iol.ssp"


def read_xml(path, name):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read(name))


def structure(path):
    return read_xml(path, "SystemStructure.ssd")


def check_by_schemas(path, elements):
    sets = [(f"resources/{n}.ssv", "SystemStructureParameterValues.xsd") for n in elements]
    for file, schema in (("SystemStructure.ssd", "SystemStructureDescription.xsd"), *sets):
        etree.XMLSchema(file=str(SCHEMAS / schema)).assertValid(read_xml(path, file))


def connections(path):
    keys = "startElement", "startConnector", "endElement", "endConnector"
    nodes = structure(path).iterfind(".//ssd:Connection", SPACES)
    return {tuple(node.get(key) for key in keys) for node in nodes}


# by the standard


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_a_system_is_valid_and_connects_every_measurement_and_law_port(systems, name):
    check_by_schemas(systems[name], ["plant", "controller"])
    wanted = {("plant", s, "controller", s) for s in "xvzi"}
    assert connections(systems[name]) == wanted | {("controller", p, "plant", p) for p in LAW}


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_connectors_parameters_and_units_are_those_of_the_fmus(systems, fmus, name):
    root = structure(systems[name])
    for element, fmu in (("plant", "plant"), ("controller", name)):
        description = fmpy.read_model_description(str(fmus[fmu]))
        real = {v.name: v for v in description.modelVariables if v.type == "Real"}
        component = root.find(f".//ssd:Component[@name='{element}']", SPACES)
        connectors = {
            c.get("name"): (c.get("kind"), c.find("ssc:Real", SPACES).get("unit"))
            for c in component.iterfind(".//ssd:Connector", SPACES)
        }
        assert connectors == {n: (v.causality, v.unit) for n, v in real.items()}
        found = read_xml(systems[name], f"resources/{element}.ssv").iterfind(
            ".//ssv:Parameter", SPACES
        )
        values = {p.get("name"): dict(p.find("ssv:Real", SPACES).attrib) for p in found}
        defaults = {
            n: {"value": v.start, "unit": v.unit}
            for n, v in real.items()
            if v.causality == "parameter"
        }
        if element == "controller":
            defaults["x_d"] = {"value": "0.08", "unit": "m"}
            units = {"v_d": "m/s", "a_d": "m/s^2"}
            defaults |= {n: {"value": "0.0", "unit": u} for n, u in units.items() if n in real}
        assert values == defaults


def test_omsimulator_finds_its_master_where_it_looks_for_it(systems):
    """Without it, its executable ends with "[NewSystem] internal error"."""
    oms = "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}"
    (annotation,) = structure(systems["nctf"]).iterfind(
        "ssd:System/ssd:Annotations/ssc:Annotation", SPACES
    )
    assert annotation.get("type") == "org.openmodelica"
    (master,) = annotation.iterfind(f"{oms}Annotations/{oms}SimulationInformation/*")
    assert (master.tag, master.get("description")) == (oms + "FixedStepMaster", "oms-ma")
    # it hands this on to the FMUs, whose solvers take it for their own
    assert (master.get("stepSize"), master.get("relativeTolerance")) == ("0.0002", "1e-08")
    # it looks for the elements by these letters
    with zipfile.ZipFile(systems["nctf"]) as archive:
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
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                root = etree.fromstring(data)
                variables = root.find("ModelVariables")
                for variable in list(variables):
                    if variable.get("name") in names:
                        variables.remove(variable)
                root.remove(root.find("ModelStructure"))
                data = etree.tostring(root)
            new.writestr(name, data)
    return target


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


# native FMUs, and other readers


@pytest.mark.ci
def test_our_own_command_runs_the_system_of_native_fmus_that_it_wrote(native_system, tmp_path):
    with zipfile.ZipFile(native_system) as archive:
        for side in ("plant", "controller"):
            path = Path(archive.extract(f"resources/{side}.fmu", tmp_path))
            with zipfile.ZipFile(path) as fmu:
                assert "sources/fmi2.c" in fmu.namelist()
                assert not [n for n in fmu.namelist() if n.endswith(".py")]
    out = tmp_path / "out"
    assert main(["run", "--system", str(native_system), "--stop", "0.5", "--out", str(out)]) == 0
    truth = run_monolithic(Loop("iol", reference=Reference.constant(0.08), stop=0.5), 1e-3)
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    assert abs(table["x"][-1] - truth.outputs["x"][-1]) < 1e-5


@pytest.mark.ci
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pyssp_standard_opens_it_and_finds_nothing_to_complain_of(
    systems, native, tmp_path, version
):
    """FMUs of FMI 3 make an SSP 2.0."""
    pyssp = pytest.importorskip("pyssp_standard.ssp", reason="needs pyssp_standard")
    path = systems["nctf"]
    if version == "2.0":
        path = export_system(native("plant", 3), native("pid", 3), tmp_path / "3.ssp", name="3")
    with pyssp.SSP(path, mode="r") as system:
        with system.system_structure as ssd:
            assert ssd.version == version
            ssd.__check_compliance__()
            assert ssd.check_connections(connector_not_in_system=True) == []
            assert len(ssd.connections()) == 14
        for parameters in system.ssv:
            parameters.__check_compliance__()
        assert len(system.resources) == 4
