"""FMUs that start from their inputs, and PIDs in Python whose command comes in the step alone."""

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from cases import ballscrew, case, maker

PYTHONFMU = Path(sys.executable).with_name("pythonfmu")


@pytest.fixture
def built(tmp_path):
    """Build one of the case's FMUs; the folder that it lies in."""

    def build(name):
        folder = case("inputs_after_initialization", tmp_path)
        words = [PYTHONFMU, "build", "-f", f"{name}.py"]
        subprocess.run(words, cwd=folder, check=True, capture_output=True)
        return folder

    return build


def course(folder, words, code=0):
    answer = ballscrew(folder, f"run {words} --out out")
    assert answer.returncode == code, answer.stderr
    return np.genfromtxt(folder / "out" / "trajectory.csv", delimiter=",", names=True)


def test_a_set_point_is_there_when_initialization_ends(built):
    run = course(built("Probe"), "--controller Probe.fmu --step 1e-3 --stop 0.01")
    np.testing.assert_array_equal(run["u"], 9.0)


def test_a_measurement_is_there_when_initialization_ends(built):
    start = "--set plant.x_start=0.05"
    run = course(built("ProbeX"), f"--controller ProbeX.fmu {start} --step 1e-3 --stop 0.01")
    np.testing.assert_array_equal(run["u"], 6.0)


def test_what_holds_the_axis_where_it_is_leaves_it_there(built):
    start = "--set plant.x_start=0.05 --setpoint 0.05"
    run = course(built("Hold"), f"--controller Hold.fmu {start} --step 1e-3 --stop 0.2")
    np.testing.assert_array_equal(run["x"], 0.05)


@pytest.mark.parametrize("name", ["PidA", "PyPid"])
def test_a_pid_that_answers_in_its_step_is_trusted_and_right(built, name):
    """With and without a start value of the command."""
    folder = built(name)
    options = "--step 5e-4 --stop 1"
    run = course(folder, f"--controller {name}.fmu {options}")
    own = course(folder, f"--controller pid {options}")
    assert np.abs(run["x"] - own["x"]).max() < 2e-5


def test_a_first_command_that_jacobi_does_not_wait_for_is_told(built):
    """A shorter step is not what such a run needs: its command begins at 0."""
    folder = built("PyPid")
    words = "run --controller PyPid.fmu --step 1e-3 --stop 0.1 --out out --coupling jacobi"
    late = ballscrew(folder, words)
    assert late.returncode == 1
    assert "u starts at 0 and is 33.49 after the first step of the controller" in late.stderr
    assert "use --coupling gauss-seidel" in late.stderr
    assert "smaller --step" not in late.stderr


SYSTEM = """<?xml version="1.0"?>
<ssd:SystemStructureDescription name="s" version="1.0"
  xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
  xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"><ssd:System name="s">
<ssd:Connectors><ssd:Connector name="x_d" kind="input"><ssc:Real/></ssd:Connector></ssd:Connectors>
<ssd:Elements>
<ssd:Component name="plant" source="cart.fmu"><ssd:Connectors>
<ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="x" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors></ssd:Component>
<ssd:Component name="controller" source="hold.fmu"><ssd:Connectors>
<ssd:Connector name="x" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="x_d" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="u" kind="output"><ssc:Real/></ssd:Connector>
<ssd:Connector name="seen" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
</ssd:Component></ssd:Elements><ssd:Connections>
<ssd:Connection startElement="plant" startConnector="x" endElement="controller" endConnector="x"/>
<ssd:Connection startElement="controller" startConnector="u" endElement="plant" endConnector="u"/>
<ssd:Connection startConnector="x_d" endElement="controller" endConnector="x_d"/>
</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"""


@pytest.fixture
def holding(tmp_path):
    """A folder with a controller that holds where it was at the start plus what it is given there.

    Its output follows its measurement at once; `seen` is 1 + 100 x_d as it was at the start.
    """
    mk = maker()
    ports = [(n, "input", 0, "") for n in ("x", "v", "x_d")]
    mk.build(
        str(tmp_path / "hold.fmu"),
        "hold",
        [*ports, ("u", "output", None, ""), ("seen", "output", None, "")],
        init="S[0]=$x$;S[1]=1+100*$x_d$;",
        out="$u$=418.0*(S[0]-$x$)-0.15*$v$;$seen$=S[1];",
    )
    mk.plant(str(tmp_path / "cart.fmu"))
    return tmp_path


def test_an_element_of_a_system_starts_from_its_inputs(holding):
    with zipfile.ZipFile(holding / "s.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SYSTEM)
        for name in ("hold", "cart"):
            archive.write(holding / f"{name}.fmu", f"{name}.fmu")
    run = course(holding, "--system s.ssp --setpoint 0.08 --step 1e-3 --stop 0.01")
    np.testing.assert_array_equal(run["controllerseen"], 9.0)


def test_tangents_and_maps_over_fmus_start_from_their_inputs(holding):
    """The axis is held where it starts: at rest, and with a map's error of what is left to go."""
    loop = "--controller hold.fmu --via fmu --setpoint 0.06 --stop 0.05"
    answer = ballscrew(holding, f"lyapunov {loop} --set plant.x_start=0.05 --out l")
    assert answer.returncode == 0, answer.stderr
    assert "no output moves by more than 0 of its range" in answer.stdout
    grid = "--x plant.x_start=0.04:0.05:2 --y plant.Fc=1:1.01:2 --workers 1"
    answer = ballscrew(holding, f"map {loop} {grid} --out m")
    assert answer.returncode == 0, answer.stderr
    found = pq.read_table(holding / "m" / "map.parquet").to_pydict()
    expected = np.array(found["plant.x_start"]) - 0.06
    np.testing.assert_allclose(found["final_error"], expected, atol=1e-12)
