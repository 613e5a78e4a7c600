"""What lies beside an exported FMU for the FMI cross-check, and the default run of a loop."""

import csv

import fmpy
import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.fmus.catalogue import fmu, fmu_kernel
from ballscrew.fmus.reference_files import reference_files
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic


def table(text):
    """Names and numbers of a CSV text, by the cross-check's rules."""
    head, *rows = text.splitlines()
    names = next(csv.reader([head]))
    assert head == ",".join(f'"{n}"' for n in names)
    return names, np.array([[float(v) for v in row.split(",")] for row in rows])


def options(text):
    return {name: float(value) for name, value in (row.split(", ") for row in text.splitlines())}


@pytest.mark.parametrize("name", ["plant", "nctf", "pid_sampled", "plant_classical"])
def test_a_host_that_does_what_the_files_say_gets_their_reference(name):
    files, path = reference_files(fmu_kernel(name)), fmu(name)
    assert sorted(files) == ["_in.csv", "_ref.csv", "_ref.opt"]
    names, expected = table(files["_ref.csv"])
    variables = {v.name for v in fmpy.read_model_description(str(path)).modelVariables}
    assert set(names) - {"time"} <= variables
    assert len(names) <= 11
    asked = options(files["_ref.opt"])
    assert {"StartTime", "StopTime", "StepSize", "RelTol"} <= set(asked)
    assert expected[0, 0] == asked["StartTime"]
    assert expected[-1, 0] == asked["StopTime"]
    columns, held = table(files["_in.csv"])
    driven = np.array([tuple(row) for row in held], dtype=[(n, float) for n in columns])
    course = fmpy.simulate_fmu(
        str(path),
        stop_time=asked["StopTime"],
        step_size=asked["StepSize"],
        output_interval=asked["OutputIntervalLength"],
        relative_tolerance=asked["RelTol"],
        input=driven,
        output=names[1:],
    )
    for k, n in enumerate(names[1:], 1):
        size = np.abs(expected[:, k]).max() or 1.0
        assert np.abs(course[n] - expected[:, k]).max() < 1e-6 * size, n
    assert np.ptp(expected[:, 1:], axis=0).max() > 1e-3  # something happens


def test_the_default_run_of_a_loop_is_the_step_of_eight_centimetres_and_its_reference():
    path = fmu("nctf", "plant")
    description = fmpy.read_model_description(str(path))
    assert description.modelName == description.coSimulation.modelIdentifier == "nctf_loop"
    experiment = description.defaultExperiment
    assert float(experiment.stopTime) == 20.0
    assert float(experiment.tolerance) == 1e-8
    course = fmpy.simulate_fmu(str(path), output=["x"])
    assert course["time"][-1] == 20.0
    assert course["x"][0] == 0.0
    assert abs(course["x"][-1] - 0.08) < 1e-4
    truth = run_monolithic(Loop("nctf", reference=Reference.constant(0.08), stop=2.0), 1e-2)
    files = reference_files(fmu_kernel("nctf", "plant"))
    assert sorted(files) == ["_ref.csv", "_ref.opt"]  # its set-point is where it starts
    names, expected = table(files["_ref.csv"])
    assert np.abs(expected[:, names.index("x")] - truth.outputs["x"]).max() < 1e-8


@pytest.mark.parametrize("more", [[], ["--native"]])
def test_the_command_writes_them_into_a_folder_of_their_own(tmp_path, more):
    assert main(["export", "--only", "nctf", *more, "--out", str(tmp_path)]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["nctf.fmu", "reference"]
    expected = reference_files(fmu_kernel("nctf"))
    written = {p.name.removeprefix("nctf"): p for p in (tmp_path / "reference").iterdir()}
    assert {suffix: p.read_text() for suffix, p in written.items()} == expected
