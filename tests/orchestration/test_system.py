"""Closed loops from .ssp files: ours, and third-party ones with more parts, units, start values."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from third_party_fmus import feedthrough, proportional

from ballscrew.cli import main
from ballscrew.fmus.catalogue import fmu
from ballscrew.fmus.system_export import export_system
from ballscrew.fmus.system_reading import BadSystem
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.limits import BadParameter
from ballscrew.orchestration.loop import Loop, SystemLoop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.whole_loop import run_monolithic

STEP = 1e-3  # where runs are compared with each other, none needs to choose its step


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ssp")
    return {
        name: export_system(fmu("plant"), fmu(name), folder / f"{name}.ssp", name=name)
        for name in ("iol", "nctf", "pid_sampled")
    }


def test_our_own_file_gives_the_same_run_as_the_parts_by_name(ours):
    for name, path in ours.items():
        by_file = run_closed_loop(SystemLoop(path, stop=0.2, step=STEP)).run
        by_name = run_closed_loop(Loop(name, stop=0.2, step=STEP)).run
        assert by_file.coupling is by_name.coupling
        assert by_file.verdict.word == by_name.verdict.word
        np.testing.assert_array_equal(by_file.time, by_name.time)
        np.testing.assert_array_equal(by_file.reference, by_name.reference)
        for column, course in by_name.outputs.items():
            np.testing.assert_array_equal(by_file.outputs[column], course)


def test_a_system_of_fmi_3_runs_as_one_of_fmi_2_does(native, tmp_path):
    path = export_system(native("plant"), native("iol"), tmp_path / "two.ssp", name="two")
    with zipfile.ZipFile(path) as two, zipfile.ZipFile(tmp_path / "three.ssp", "w") as three:
        for file in two.namelist():
            name = {"resources/plant.fmu": "plant", "resources/controller.fmu": "iol"}.get(file)
            three.writestr(file, native(name, 3).read_bytes() if name else two.read(file))
    expected = run_closed_loop(SystemLoop(path, stop=0.1, step=STEP)).run
    found = run_closed_loop(SystemLoop(tmp_path / "three.ssp", stop=0.1, step=STEP)).run
    assert found.coupling is expected.coupling
    np.testing.assert_allclose(found.outputs["x"], expected.outputs["x"], rtol=0, atol=1e-12)
    written = export_system(native("plant", 3), native("iol", 3), tmp_path / "w.ssp", name="three")
    again = run_closed_loop(SystemLoop(written, stop=0.1, step=STEP)).run
    np.testing.assert_array_equal(again.outputs["x"], found.outputs["x"])


def test_a_plain_master_that_connects_the_law_ports_is_right_with_second_order(ours):
    """4.2e-4 m at 1e-3 s and 1.8e-5 m at 2e-4 s: what other masters get from the same file."""
    truth = run_monolithic(Loop("iol", reference=Reference.constant(0.08), stop=2.0), 1e-4)
    errors = {}
    for h in (1e-3, 2e-4):
        run = run_closed_loop(
            SystemLoop(ours["iol"], stop=2.0, step=h, coupling=Coupling.JACOBI)
        ).run
        assert set(run.commands) >= {"u", "u_gain_i", "u_ref_i", "u_rate"}
        exact = np.interp(run.time, truth.time, truth.outputs["x"])
        errors[h] = np.abs(run.outputs["x"] - exact).max()
    assert errors[1e-3] == pytest.approx(4.2e-4, rel=0.03)
    assert errors[2e-4] == pytest.approx(1.8e-5, rel=0.03)
    assert np.log(errors[1e-3] / errors[2e-4]) / np.log(5) == pytest.approx(2.0, abs=0.1)


def test_set_point_stop_time_and_parameters_come_from_the_file_unless_told(ours, tmp_path):
    short = export_system(
        fmu("plant"), fmu("nctf"), tmp_path / "short.ssp", name="s", setpoint=-0.03, stop=0.05
    )
    own = run_closed_loop(SystemLoop(short)).run
    assert own.time[-1] == 0.05
    assert set(own.reference) == {-0.03}
    told = run_closed_loop(
        SystemLoop(short, Reference.constant(0.02), stop=0.1, values={"plant.sigma0": 6e4})
    ).run
    same = run_closed_loop(
        Loop("nctf", reference=Reference.constant(0.02), stop=0.1, plant_values={"sigma0": 6e4})
    ).run
    np.testing.assert_array_equal(told.outputs["z"], same.outputs["z"])


SSD = """<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="strange"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="strange">
    {inputs}
    {values}
    <ssd:Elements>{elements}</ssd:Elements>
    <ssd:Connections>{connections}</ssd:Connections>
  </ssd:System>
  {tail}
</ssd:SystemStructureDescription>
"""


def strange(path: Path, elements, connections, inputs="", values="", tail=""):
    """An .ssp written by hand: FMU files by name, and connections such as "a.x -> b.y * 2"."""

    def component(name):
        return f'<ssd:Component name="{name}" source="resources/{name}.fmu"/>'

    def connection(text):
        ends, _, factor = text.partition(" * ")
        (a, x), (b, y) = (end.rpartition(".")[::2] for end in ends.split(" -> "))
        element = f'startElement="{a}" ' if a else ""
        scaled = f'<ssc:LinearTransformation factor="{factor}"/>' if factor else ""
        return (
            f'<ssd:Connection {element}startConnector="{x}" endElement="{b}" endConnector="{y}">'
            f"{scaled}</ssd:Connection>"
        )

    text = SSD.format(
        inputs=inputs,
        values=values,
        elements="".join(map(component, elements)),
        connections="".join(map(connection, connections)),
        tail=tail,
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        for name, file in elements.items():
            archive.write(file, f"resources/{name}.fmu")
    return path


LOOP = ["axis.x -> ctl.x", "axis.v -> ctl.v", "ctl.u -> axis.u"]
INPUT = """<ssd:Connectors><ssd:Connector name="goal" kind="input"><ssc:Real/></ssd:Connector>
</ssd:Connectors>"""
START = """<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="{name}">
<ssv:Real value="{value}"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>
</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"""


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    return {
        "axis": fmu("plant"),
        "ctl": proportional(folder, "Ctl"),
        "amplifier": feedthrough(folder, "Amplifier"),
    }


def test_two_third_party_parts_run_as_they_do_by_name(parts, tmp_path):
    path = strange(
        tmp_path / "two.ssp",
        {k: parts[k] for k in ("ctl", "axis")},
        [*LOOP, ".goal -> ctl.x_d"],
        INPUT,
        START.format(name="goal", value=0.05),
    )
    by_file = run_closed_loop(SystemLoop(path, stop=0.2, step=STEP)).run
    by_name = run_closed_loop(
        Loop(str(parts["ctl"]), reference=Reference.constant(0.05), stop=0.2, step=STEP)
    ).run
    np.testing.assert_array_equal(by_file.outputs["x"], by_name.outputs["x"])
    np.testing.assert_array_equal(by_file.commands["u"], by_name.commands["u"])


def test_parts_between_controller_and_plant_are_stepped_in_the_order_of_the_signals(
    parts, tmp_path
):
    """A gain of 1, listed before the controller, changes nothing; one of a half halves u."""
    direct = strange(
        tmp_path / "direct.ssp",
        {k: parts[k] for k in ("ctl", "axis")},
        [*LOOP, ".g -> ctl.x_d"],
        INPUT.replace("goal", "g"),
    )
    through = strange(
        tmp_path / "through.ssp",
        {k: parts[k] for k in ("amplifier", "axis", "ctl")},
        [*LOOP[:2], "ctl.u -> amplifier.a", "amplifier.b -> axis.u", ".g -> ctl.x_d"],
        INPUT.replace("goal", "g"),
    )
    goal = Reference.constant(0.08)
    one = run_closed_loop(SystemLoop(direct, goal, stop=0.1, step=STEP)).run
    two = run_closed_loop(SystemLoop(through, goal, stop=0.1, step=STEP)).run
    np.testing.assert_allclose(two.outputs["x"], one.outputs["x"], atol=1e-9)
    half = run_closed_loop(
        SystemLoop(through, goal, stop=0.1, step=STEP, values={"amplifier.gain": 0.5})
    ).run
    assert half.commands["u"][0] == pytest.approx(0.5 * one.commands["u"][0], rel=1e-9)


def test_a_factor_on_a_connection_is_honoured(parts, tmp_path):
    scaled = strange(
        tmp_path / "scaled.ssp",
        {k: parts[k] for k in ("axis", "ctl")},
        [*LOOP[:2], "ctl.u -> axis.u * 0.5", ".goal -> ctl.x_d * 0.01"],
        INPUT,
    )
    run = run_closed_loop(SystemLoop(scaled, Reference.constant(8.0), stop=0.05, step=1e-4)).run
    plain = strange(
        tmp_path / "plain.ssp",
        {k: parts[k] for k in ("axis", "ctl", "amplifier")},
        [*LOOP[:2], "ctl.u -> amplifier.a", "amplifier.b -> axis.u", ".goal -> ctl.x_d"],
        INPUT,
    )
    study = SystemLoop(
        plain,
        Reference.constant(0.08),
        stop=0.05,
        step=1e-4,
        values={"amplifier.gain": 0.5},
        coupling=Coupling.GAUSS_SEIDEL,
    )
    np.testing.assert_allclose(
        run.outputs["x"], run_closed_loop(study).run.outputs["x"], atol=1e-12
    )


@pytest.mark.parametrize(
    ("elements", "connections", "tail", "match"),
    [
        (["axis"], [], "", "has one element"),
        (["axis", "ctl"], LOOP[:2], "", "nothing drives 'axis'"),
        (
            ["axis", "ctl"],
            LOOP,
            '<ssd:DefaultExperiment startTime="1" stopTime="2"/>',
            "expected 0",
        ),
    ],
)
def test_systems_that_make_no_loop_are_refused(parts, tmp_path, elements, connections, tail, match):
    path = strange(tmp_path / "s.ssp", {k: parts[k] for k in elements}, connections, tail=tail)
    with pytest.raises(BadSystem, match=match):
        run_closed_loop(SystemLoop(path))


def test_unknown_elements_and_parameters_are_named_with_the_nearest(ours):
    with pytest.raises(BadParameter, match=r"no element 'plnt'; nearest: plant"):
        run_closed_loop(SystemLoop(ours["iol"], values={"plnt.sigma0": 1.0}))
    with pytest.raises(BadParameter, match=r"plant has no parameter 'sigma'; nearest: sigma"):
        run_closed_loop(SystemLoop(ours["iol"], values={"plant.sigma": 1.0}))


def test_the_command_line_exports_and_runs_systems(tmp_path, capsys):
    assert main(["export", "--ssp", "--only", "nctf", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "nctf.ssp")
    out = tmp_path / "out"
    path = str(tmp_path / "nctf.ssp")
    assert main(["run", "--system", path, "--stop", "0.1", "--out", str(out)]) == 0
    assert (out / "trajectory.csv").read_text().startswith("time,x,v,z,i,u,")
    assert '"controller": "nctf"' in (out / "metrics.json").read_text()
    for more in (["--plant", "p.fmu"], ["--map", "a=b"], ["--coupling", "monolithic"]):
        capsys.readouterr()
        assert main(["run", "--system", path, *more, "--out", str(out)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
