"""FMUs that start from their inputs, and PIDs in Python whose command comes in the step alone."""

import numpy as np
import pytest
from case_inputs import system
from cases import case, trajectory


@pytest.fixture
def folder(tmp_path):
    return case("inputs_after_initialization", tmp_path)


def test_what_was_set_is_there_when_initialization_ends(folder, command):
    """u is 1 + 100 x_d or 1 + 100 x of that moment, for ever."""
    started = "--set plant.x_start=0.05"
    for name, words, u in (("probe", "", 9.0), ("probe_x", started, 6.0)):
        words = (
            f"run --no-isolate --controller {name}.fmu {words} --step 1e-3 --stop 0.01 --out out"
        )
        assert command(folder, words)[0] == 0
        np.testing.assert_array_equal(trajectory(folder / "out")["u"], u)


def test_an_element_of_a_system_starts_from_its_inputs(folder, command):
    system(folder, "s.ssp", controller="hold")
    words = "run --no-isolate --system s.ssp --setpoint 0.08 --step 1e-3 --stop 0.01 --out out"
    assert command(folder, words)[0] == 0
    np.testing.assert_array_equal(trajectory(folder / "out")["holdseen"], 9.0)


@pytest.mark.ci
@pytest.mark.parametrize("name", ["PidA", "PyPid"])
def test_a_pid_that_answers_in_its_step_is_a_digital_one_with_the_step_as_period(
    folder, command, name
):
    """With and without a start value of the command; its law is that of the continuous pid."""
    courses = []
    for controller in (f"{name}.fmu", f"{name}.fmu --sampled 1e-3", "pid"):
        words = f"run --no-isolate --controller {controller} --stop 1 --out out"
        code, _, said = command(folder, words)
        assert code == 0
        own = f"note: {name} computes its outputs in its steps only: it is run as a digital"
        assert (own in said) == (not courses)
        courses.append(trajectory(folder / "out")["x"])
    np.testing.assert_array_equal(courses[0], courses[1])
    every = (len(courses[2]) - 1) // (len(courses[0]) - 1)
    assert np.abs(courses[0] - courses[2][::every]).max() < 4e-5


def test_a_first_command_that_jacobi_does_not_wait_for_is_told(folder, command):
    """A shorter step is not what such a run needs: its command begins at 0."""
    words = (
        "run --no-isolate --controller Fixed.fmu --step 1e-3 --stop 0.1 --out out --coupling jacobi"
    )
    code, _, said = command(folder, words)
    assert code == 1
    assert "u starts at 0 and is 33.49 after the first step of the controller" in said
    assert "use the coupling gauss-seidel" in said
    assert "use shorter communication steps" not in said


@pytest.mark.ci
def test_tangents_over_fmus_start_from_their_inputs(folder, command):
    """The axis is held where it starts, at rest."""
    loop = "--controller hold.fmu --via fmu --setpoint 0.06 --stop 0.05"
    code, printed, said = command(folder, f"lyapunov {loop} --set plant.x_start=0.05 --out l")
    assert code == 0, said
    assert "no output moves by more than 0 of its range" in printed
