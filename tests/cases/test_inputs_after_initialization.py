"""FMUs that start from their inputs, and PIDs in Python whose command comes in the step alone."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import ballscrew, case

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
