"""Closed loops as one .ssp: by the standard, in other readers, and run by other masters."""

import json
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from pathlib import Path

import fmpy
import fmpy.ssp
import numpy as np
import pytest
from every_component import EVERY_CONTROLLER
from fmu_host import opened
from lxml import etree

from ballscrew.cli import main
from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus.reading import FmuError
from ballscrew.fmus.system_export import CannotConnect, export_system
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic
from ballscrew.solver.compilers import compiler_for, own_platform

SCHEMAS = Path(fmpy.ssp.__file__).with_name("schema")
SPACES = {
    prefix: f"http://ssp-standard.org/SSP1/SystemStructure{part}"
    for prefix, part in (
        ("ssc", "Common"),
        ("ssd", "Description"),
        ("ssv", "ParameterValues"),
    )
}
SIGNALS = ("x", "v", "z", "i", "friction")
LAW = [
    "u", *(f"u_gain_{s}" for s in "xvzi"), *(f"u_ref_{s}" for s in "xvzi"), "u_rate",
]  # fmt: skip


@pytest.fixture(scope="module")
def systems(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("systems")
    return {
        name: export_system(fmus["plant"], fmus[name], folder / f"{name}.ssp", name=name)
        for name in CONTROLLERS
    }


def read_xml(path, name):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read(name))


def structure(path):
    return read_xml(path, "SystemStructure.ssd")


# by the standard


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_descriptions_and_parameter_sets_are_valid_by_the_standard_s_schemas(systems, name):
    for file, schema in (
        ("SystemStructure.ssd", "SystemStructureDescription.xsd"),
        ("resources/plant.ssv", "SystemStructureParameterValues.xsd"),
        ("resources/controller.ssv", "SystemStructureParameterValues.xsd"),
    ):
        etree.XMLSchema(file=str(SCHEMAS / schema)).assertValid(read_xml(systems[name], file))


def test_omsimulator_finds_its_master_where_it_looks_for_it(systems):
    """Without it, its executable ends with "[NewSystem] internal error"."""
    oms = "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}"
    (annotation,) = structure(systems["iol"]).iterfind(
        "ssd:System/ssd:Annotations/ssc:Annotation", SPACES
    )
    assert annotation.get("type") == "org.openmodelica"
    (master,) = annotation.iterfind(f"{oms}Annotations/{oms}SimulationInformation/*")
    assert master.tag == oms + "FixedStepMaster"
    assert master.get("description") == "oms-ma"
    # it hands this on to the FMUs, whose solvers take it for their own
    assert (master.get("stepSize"), master.get("relativeTolerance")) == ("0.0002", "1e-08")
    # it looks for the elements by these letters
    with zipfile.ZipFile(systems["iol"]) as archive:
        assert b"<oms:FixedStepMaster" in archive.read("SystemStructure.ssd")


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_every_measurement_and_every_law_port_is_connected(systems, name):
    connections = {
        tuple(
            c.get(key) for key in ("startElement", "startConnector", "endElement", "endConnector")
        )
        for c in structure(systems[name]).iterfind(".//ssd:Connection", SPACES)
    }
    wanted = {("plant", s, "controller", s) for s in "xvzi"}
    wanted |= {("controller", p, "plant", p) for p in LAW}
    assert connections == wanted


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


@pytest.mark.parametrize("file", ["SystemStructure.ssd", "resources/plant.ssv"])
def test_every_unit_is_defined_by_the_exponents_of_base_units(systems, file):
    root = read_xml(systems["iol"], file)
    units = {
        u.get("name"): {k: int(p) for k, p in u.find("ssc:BaseUnit", SPACES).attrib.items()}
        for u in root.iterfind(".//ssc:Unit", SPACES)
    }
    used = {node.get("unit") for node in root.iter() if node.get("unit")}
    assert used <= set(units)
    assert units["N*m/A"] == {"kg": 1, "m": 2, "s": -2, "A": -1}
    assert units["1"] == {}


def test_the_archive_holds_the_fmus_as_they_are(systems, fmus):
    with zipfile.ZipFile(systems["nctf"]) as archive:
        assert archive.read("resources/plant.fmu") == fmus["plant"].read_bytes()
        assert archive.read("resources/controller.fmu") == fmus["nctf"].read_bytes()
        assert len(archive.namelist()) == 5


def test_export_is_reproducible_byte_for_byte(systems, fmus, tmp_path):
    python(
        """
        import sys
        from ballscrew.fmus.system_export import export_system
        export_system(*sys.argv[1:4], name="iol")
        """,
        fmus["plant"],
        fmus["iol"],
        tmp_path / "again.ssp",
    )
    assert (tmp_path / "again.ssp").read_bytes() == systems["iol"].read_bytes()


def test_set_point_and_stop_time_are_as_asked(fmus, tmp_path):
    path = export_system(
        fmus["plant"], fmus["pid"], tmp_path / "a.ssp", name="a", setpoint=-0.03, stop=5.0
    )
    (x_d,) = read_xml(path, "resources/controller.ssv").iterfind(
        ".//ssv:Parameter[@name='x_d']/ssv:Real", SPACES
    )
    assert x_d.get("value") == "-0.03"
    assert structure(path).find("ssd:DefaultExperiment", SPACES).get("stopTime") == "5.0"


# what makes no system


def test_sides_that_do_not_meet_are_refused_with_one_line(fmus, tmp_path):
    path = tmp_path / "loop.ssp"
    with pytest.raises(
        CannotConnect,
        match=r"its inputs do not fit the outputs of .*: its inputs are x, v",
    ):
        export_system(fmus["iol"], fmus["nctf"], path, name="two controllers")
    with pytest.raises(CannotConnect, match="the set-point is nan"):
        export_system(fmus["plant"], fmus["nctf"], path, name="a", setpoint=float("nan"))
    with pytest.raises(CannotConnect, match=r"the stop time is 0\.0 s"):
        export_system(fmus["plant"], fmus["nctf"], path, name="a", stop=0.0)
    with pytest.raises(FmuError, match="no such file"):
        export_system(fmus["plant"], tmp_path / "gone.fmu", path, name="a")
    silent = without_outputs(fmus["pid"], tmp_path / "silent.fmu", "u")
    with pytest.raises(CannotConnect, match=r"nothing is connected to the input 'u' of .*plant"):
        export_system(fmus["plant"], silent, path, name="a")
    assert not path.exists()


def without_outputs(source, target, *names):
    """A copy of an FMU whose description does not mention some outputs."""
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


def test_a_gain_is_left_out_where_its_reference_is_missing(fmus, tmp_path):
    """Alone it would multiply the whole signal, not the change since the command was computed."""
    partial = without_outputs(fmus["pid"], tmp_path / "partial.fmu", "u_ref_x", "u_gain_v")
    path = export_system(fmus["plant"], partial, tmp_path / "partial.ssp", name="partial")
    connected = {
        c.get("startConnector")
        for c in structure(path).iterfind(".//ssd:Connection[@startElement='controller']", SPACES)
    }
    assert connected == set(LAW) - {"u_ref_x", "u_gain_x", "u_ref_v", "u_gain_v"}


# other readers


def test_fmus_of_fmi_3_make_an_ssp_2_that_pyssp_standard_finds_right(native, tmp_path):
    pyssp = pytest.importorskip("pyssp_standard.ssp", reason="needs pyssp_standard")
    path = export_system(native("plant", 3), native("pid", 3), tmp_path / "three.ssp", name="three")
    with pyssp.SSP(path, mode="r") as system:
        with system.system_structure as ssd:
            assert ssd.version == "2.0"
            ssd.__check_compliance__()
            assert ssd.check_connections(connector_not_in_system=True) == []
        for parameters in system.ssv:
            parameters.__check_compliance__()


@pytest.mark.parametrize("name", EVERY_CONTROLLER)
def test_pyssp_standard_opens_it_and_finds_nothing_to_complain_of(systems, name):
    pyssp = pytest.importorskip("pyssp_standard.ssp", reason="needs pyssp_standard")
    with pyssp.SSP(systems[name], mode="r") as system:
        with system.system_structure as ssd:
            ssd.__check_compliance__()
            complaints = ssd.check_connections(connector_not_in_system=True)
            assert complaints == []
            assert len(ssd.connections()) == 14
        for parameters in system.ssv:
            parameters.__check_compliance__()
        assert {Path(name).name for name in system.resources} == {
            "plant.fmu",
            "plant.ssv",
            "controller.fmu",
            "controller.ssv",
        }


# other masters


def python(code, *arguments):
    """Output of code run in a process of its own: a third-party program may crash at its end."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
        timeout=120,
    )
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stdout}{done.stderr}"
    return done.stdout


LIBCOSIM = """
    import json, sys
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    path, step, steps = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_ssp_file(path, round(step * 1e9))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    plant = execution.slave_index_from_instance_name("plant")
    references = {v.name.decode(): v.reference for v in execution.slave_variables(plant)}
    wanted = [references[name] for name in sys.argv[4:]]
    rows = []
    for _ in range(steps):
        assert execution.step()
        rows.append(list(observer.last_real_values(plant, wanted)))
    print(json.dumps(rows))
"""
ECOS = """
    import json, sys
    from ecospy import EcosLib, EcosSimulation

    path, step, steps = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    EcosLib.set_log_level("warn")
    rows = []
    with EcosSimulation(step, ssp_path=path) as simulation:
        assert simulation.init(parameter_set="parameters")
        for _ in range(steps):
            simulation.step()
            rows.append([simulation.get_real("plant::" + name) for name in sys.argv[4:]])
        simulation.terminate()
    print(json.dumps(rows))
"""
MASTERS = {"libcosim": ("libcosimpy", LIBCOSIM), "ecos": ("ecospy", ECOS)}


def course(master, path, step, stop):
    """The plant's outputs after every step of a third-party master; shape (steps, signals)."""
    module, code = MASTERS[master]
    tried = subprocess.run(
        [sys.executable, "-c", f"import {module}"], capture_output=True, text=True
    )
    if tried.returncode:
        reason = tried.stderr.strip().rpartition("\n")[2]
        pytest.skip(f"{module} cannot be imported ({reason}); ecospy needs Debian's libtbb12")
    return np.array(json.loads(python(code, path, step, round(stop / step), *SIGNALS)))


def jacobi(plant_fmu, controller_fmu, step, stop):
    """The plainest master: all parts step at once with the values of the last point.

    Before the first step the controller has answered to the plant's initial outputs.
    """
    plant, at = opened(plant_fmu)
    controller, there = opened(controller_fmu, {"x_d": 0.08})
    measured = [n for n in SIGNALS if n in there]
    rows = []

    def exchange(law):
        signals = plant.getReal([at[n] for n in measured])
        plant.setReal([at[n] for n in LAW], law)
        controller.setReal([there[n] for n in measured], signals)

    def answer():
        return controller.getReal([there[n] for n in LAW])

    exchange(answer())
    exchange(answer())
    for k in range(round(stop / step)):
        plant.doStep(k * step, step)
        controller.doStep(k * step, step)
        rows.append(plant.getReal([at[n] for n in SIGNALS]))
        exchange(answer())
    for slave in (plant, controller):
        slave.terminate()
        slave.freeInstance()
    return np.array(rows)


@pytest.mark.parametrize("name", ["nctf", "iol_true_acceleration", "pid_sampled"])
@pytest.mark.parametrize("master", MASTERS)
def test_a_stranger_s_master_runs_the_system_as_a_jacobi_master_does(systems, fmus, master, name):
    ours = jacobi(fmus["plant"], fmus[name], 1e-4, 0.02)
    theirs = course(master, systems[name], 1e-4, 0.02)
    assert ours[-1, 0] > 1e-5  # metres: it moves
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def native_system(tmp_path_factory):
    """What ``ballscrew export --ssp --native`` writes of the linearizing loop."""
    if not own_platform() or not compiler_for(own_platform()):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
    folder = tmp_path_factory.mktemp("native-system")
    assert main(["export", "--ssp", "--native", "--only", "iol", "--out", str(folder)]) == 0
    assert [p.name for p in folder.iterdir()] == ["iol.ssp"]
    return folder / "iol.ssp"


def test_a_native_system_is_the_same_system_around_native_fmus(systems, native_system, tmp_path):
    file = "SystemStructure.ssd"
    assert etree.tostring(read_xml(native_system, file)) == etree.tostring(
        read_xml(systems["iol"], file)
    )
    with zipfile.ZipFile(native_system) as archive:
        for side in ("plant", "controller"):
            path = Path(archive.extract(f"resources/{side}.fmu", tmp_path))
            with zipfile.ZipFile(path) as fmu:
                assert "sources/fmi2.c" in fmu.namelist()
                assert not [n for n in fmu.namelist() if n.endswith(".py")]


@pytest.mark.parametrize("master", MASTERS)
def test_a_stranger_s_master_runs_the_native_system_to_the_same_course(
    systems, native_system, master
):
    readable, native = (course(master, p, 1e-3, 0.05) for p in (systems["iol"], native_system))
    assert readable[-1, 0] > 1e-5
    np.testing.assert_allclose(native, readable, rtol=1e-9, atol=1e-9)


def test_our_own_command_runs_the_native_system(native_system, tmp_path):
    out = tmp_path / "out"
    assert main(["run", "--system", str(native_system), "--stop", "0.5", "--out", str(out)]) == 0
    truth = run_monolithic(Loop("iol", reference=Reference.constant(0.08), stop=0.5), 1e-3)
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    assert abs(table["x"][-1] - truth.outputs["x"][-1]) < 1e-5


def test_a_native_system_can_be_made_for_another_platform(tmp_path):
    """It needs no binary that runs here; without a compiler for it, the sources are inside."""
    options = ["--native", "--platforms", "win64", "--only", "pid", "--out", str(tmp_path)]
    assert main(["export", "--ssp", *options]) == 0
    assert (tmp_path / "pid.ssp").is_file()


@pytest.mark.parametrize("master", MASTERS)
def test_the_linearizing_loop_is_right_to_second_order_in_a_stranger_s_master(systems, master):
    """Held without the law, the same loop is off by four centimetres at these steps."""
    errors = []
    for step in (1e-3, 5e-4):
        truth = run_monolithic(Loop("iol", reference=Reference.constant(0.08), stop=1.0), step)
        theirs = course(master, systems["iol"], step, 1.0)
        errors.append(np.abs(theirs[:, 0] - truth.outputs["x"][1:]).max())
    assert errors[0] < 4.5e-4
    assert 3.5 < errors[0] / errors[1] < 4.5


# with instruments

BETWEEN = ["position_encoder", "velocity_estimate"]


@pytest.fixture(scope="module")
def measured_system(fmus, tmp_path_factory):
    """The sampled NCTF loop, position and velocity through instruments."""
    return export_system(
        fmus["plant"],
        fmus["nctf_sampled"],
        tmp_path_factory.mktemp("measured") / "nctf_sampled.ssp",
        name="nctf_sampled",
        instruments={name: fmus[name] for name in BETWEEN},
    )


def test_a_system_with_instruments_is_valid_by_the_standard_s_schemas(measured_system):
    files = ["plant", *BETWEEN, "controller"]
    for file, schema in (
        ("SystemStructure.ssd", "SystemStructureDescription.xsd"),
        *((f"resources/{n}.ssv", "SystemStructureParameterValues.xsd") for n in files),
    ):
        etree.XMLSchema(file=str(SCHEMAS / schema)).assertValid(read_xml(measured_system, file))


def test_what_an_instrument_measures_goes_where_the_signal_went(measured_system):
    connections = {
        tuple(
            c.get(key) for key in ("startElement", "startConnector", "endElement", "endConnector")
        )
        for c in structure(measured_system).iterfind(".//ssd:Connection", SPACES)
    }
    wanted = {("plant", s, "controller", s) for s in "zi"} | {
        ("plant", "x", "position_encoder", "x"),
        ("position_encoder", "x_measured", "velocity_estimate", "x"),
        ("position_encoder", "x_measured", "controller", "x"),
        ("velocity_estimate", "v_measured", "controller", "v"),
    }
    # the law acts on what the controller measures at the plant itself
    law = {"u", "u_rate", *(f"u_{part}_{s}" for part in ("gain", "ref") for s in "zi")}
    assert connections == wanted | {("controller", p, "plant", p) for p in law}


def test_instruments_sample_with_a_sampled_controller(measured_system):
    (period,) = read_xml(measured_system, "resources/velocity_estimate.ssv").iterfind(
        ".//ssv:Parameter[@name='sample_time']/ssv:Real", SPACES
    )
    assert float(period.get("value")) == 5e-5


def test_instruments_that_fit_nowhere_are_refused_with_one_line(fmus, tmp_path):
    def write(controller, **instruments):
        path = tmp_path / "a.ssp"
        export_system(fmus["plant"], fmus[controller], path, name="a", instruments=instruments)

    with pytest.raises(CannotConnect, match=r"nothing is connected to the input 'x_d' of "):
        write("nctf", other=fmus["pid"])
    with pytest.raises(CannotConnect, match="output 'x' does not say what it measures"):
        write("nctf", other=without_inputs(fmus["plant"], tmp_path / "silent.fmu"))
    with pytest.raises(CannotConnect, match="an instrument is called 'plant'"):
        write("nctf", plant=fmus["position_encoder"])
    blind = without_outputs(fmus["nctf"], tmp_path / "blind.fmu", "i")
    with pytest.raises(CannotConnect, match="nothing is connected to the outputs i_measured of "):
        export_system(
            fmus["plant"],
            blind,
            tmp_path / "a.ssp",
            name="a",
            instruments={"sensor": fmus["current_sensor"]},
        )


def without_inputs(source, target):
    """A copy of an FMU whose description has no inputs."""
    inputs = fmpy.read_model_description(str(source)).modelVariables
    return without_outputs(source, target, *(v.name for v in inputs if v.causality == "input"))
