"""FMUs that are not FMI 2.0 co-simulation of real signals, as the master takes them."""

from __future__ import annotations

import re
import zipfile

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.closed_loop import Study, run_study
from ballscrew.orchestration.coupling import Coupling
from ballscrew.orchestration.fmu_instance import FmuInstance

STOP = 0.3


def course(plant, controller, **options):
    run = run_study(Study(str(controller), str(plant), stop=STOP, **options)).run
    assert not run.stopped
    return run, run.outputs | run.commands


@pytest.mark.parametrize("controller", ["iol", "pid_sampled"])
@pytest.mark.parametrize("isolate", [False, True])
def test_fmi_3_runs_as_fmi_2_does(native, controller, isolate):
    other, expected = course(native("plant"), native(controller))
    run, found = course(native("plant", 3), native(controller, 3), isolate=isolate)
    assert run.coupling is other.coupling
    assert run.verdict.trusted == other.verdict.trusted
    assert run.step_range == other.step_range
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12)


def test_what_export_writes_as_fmi_3_run_takes(tmp_path, native):
    parts = ["--plant", str(native("plant", 3)), "--controller", str(native("pid", 3))]
    assert main(["run", *parts, "--stop", "0.05", "--out", str(tmp_path)]) == 0
    assert "verdict" in (tmp_path / "metrics.json").read_text()


@pytest.fixture
def exchanged(native, tmp_path):
    """``exchanged(name, fmi)`` is the native FMU for model exchange only."""

    def packed(name, fmi=2):
        path = tmp_path / f"{name}{fmi}.fmu"
        with zipfile.ZipFile(native(name, fmi)) as both, zipfile.ZipFile(path, "w") as one:
            for file in both.namelist():
                data = both.read(file)
                if file == "modelDescription.xml":
                    element = rb"<CoSimulation[^>]*/>|<CoSimulation.*?</CoSimulation>"
                    data = re.sub(element, b"", data, flags=re.DOTALL)
                one.writestr(file, data)
        return path

    return packed


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("plant", ["plant", "plant_classical"])
def test_model_exchange_runs_as_co_simulation_does(native, exchanged, fmi, plant):
    """A sampled controller by its time events, dry friction by its state events."""
    _, expected = course(native(plant), native("pid_sampled"), coupling=Coupling.GAUSS_SEIDEL)
    _, found = course(exchanged(plant, fmi), exchanged("pid_sampled", fmi))
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-8)


def test_a_controller_for_model_exchange_reports_its_law(native, exchanged):
    _, expected = course(native("plant"), native("iol"))
    run, found = course(native("plant"), exchanged("iol", 3))
    assert run.coupling is Coupling.INTERFACE_JACOBIAN
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-12)


def test_a_plant_for_model_exchange_takes_no_law_and_the_verdict_tells_what_that_costs(exchanged):
    run, _ = course(exchanged("plant"), exchanged("iol"))
    assert run.coupling is Coupling.GAUSS_SEIDEL
    assert not run.verdict.trusted


@pytest.mark.parametrize("fmi", [2, 3])
def test_model_exchange_goes_on_from_a_saved_state_as_before(exchanged, fmi):
    plant = FmuInstance(exchanged("plant_classical", fmi), "plant")
    plant.initialize({}, 1.0)
    read, write = plant.reader(["x", "v", "i"]), plant.writer(["u"])
    write(np.array([5.0]))
    plant.step(0.0, 0.01)
    state, before = plant.save(), read()
    courses = []
    for _ in range(2):
        write(np.array([3.0]))
        for k in range(1, 5):
            plant.step(k * 0.01, 0.01)
        courses.append(read())
        plant.restore(state)
        np.testing.assert_array_equal(read(), before)
    plant.release(state)
    plant.close()
    np.testing.assert_array_equal(*courses)
