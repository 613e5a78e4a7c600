"""What lies beside an exported FMU for the FMI cross-check, and the default run of a loop."""

import csv

import fmpy
import numpy as np
import pytest
from thesis_axis import axis_under

from ballscrew.cli import main
from ballscrew.fmus.catalogue import fmu, fmu_kernel
from ballscrew.fmus.reference_files import reference_files
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)


def table(text):
    """Columns of a CSV text, by the cross-check's rules."""
    head, *rows = text.splitlines()
    names = next(csv.reader([head]))
    assert head == ",".join(f'"{n}"' for n in names)
    return dict(zip(names, np.array([row.split(",") for row in rows], float).T, strict=True))


def test_the_axis_reference_is_the_solution_of_another_solver():
    files = reference_files(fmu_kernel("plant"))
    assert sorted(files) == ["_in.csv", "_ref.csv", "_ref.opt"]
    assert {n: v.tolist() for n, v in table(files["_in.csv"]).items()} == {
        "time": [0.0, 2.0],
        "u": [5.0, 5.0],
    }
    asked = dict(row.split(", ") for row in files["_ref.opt"].splitlines())
    assert float(asked["StopTime"]) == 2.0
    assert float(asked["OutputIntervalLength"]) == 1e-2
    assert (float(asked["StepSize"]), float(asked["RelTol"])) == (1e-3, 1e-9)
    found = table(files["_ref.csv"])
    times = found.pop("time")
    assert times == pytest.approx(np.arange(201) * 1e-2, abs=1e-12)
    exact = dict(zip(("x", "v", "z", "i", "friction"), axis_under(5.0, times).T, strict=True))
    assert set(found) == set(exact)
    for name, values in exact.items():
        assert np.abs(found[name] - values).max() < 1e-8 * np.abs(values).max(), name


def test_a_controller_s_reference_is_its_exact_answer():
    """NCTF at a standstill 8 cm away: its integral grows steadily."""
    found = table(reference_files(fmu_kernel("nctf"))["_ref.csv"])
    values = {p.name: p.default for p in fmu_kernel("nctf").parameters}
    rate = values["h"] * np.tanh(values["c"] * 0.08)
    exact = rate * (values["Kp"] + values["Ki"] * found["time"])
    assert found["u"] == pytest.approx(exact, rel=1e-12)


def test_the_reference_of_a_lag_under_five_volts_is_exact_at_its_start_and_after_it():
    x, u, goal = symbol("x"), Input("u", "V", ""), Input("goal", "m", "", role="reference")
    lag = Component(
        "lag",
        "",
        inputs=(u, goal),
        states=(State("x", "1", "", symbol("u") - 2 * x, start=1.0),),
        outputs=tuple(Output(f"y{k}", "1", "", x + TIME + 100 * symbol("goal")) for k in range(12)),
    )
    found = table(reference_files(generate(lag))["_ref.csv"])
    exact = 2.5 - 1.5 * np.exp(-2 * found["time"]) + found["time"] + 8.0
    assert list(found) == ["time", *(f"y{k}" for k in range(10))]
    assert found["y0"] == pytest.approx(exact, rel=1e-9)


def test_at_a_sample_instant_the_reference_has_the_values_before_it():
    counter = Component(
        "counter",
        "",
        discrete=(DiscreteState("d", "1", "", symbol("d") + 1),),
        outputs=(Output("y", "1", "", symbol("d")),),
        sample_time=Parameter("sample_time", 5e-3, "s", "", ""),
    )
    files = reference_files(generate(counter))
    assert sorted(files) == ["_ref.csv", "_ref.opt"]
    assert table(files["_ref.csv"])["y"].tolist() == [2.0 * k for k in range(201)]


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
    assert np.abs(table(files["_ref.csv"])["x"] - truth.outputs["x"]).max() < 1e-8


@pytest.mark.parametrize("more", [[], pytest.param(["--native"], marks=pytest.mark.ci)])
def test_the_command_writes_them_into_a_folder_of_their_own(tmp_path, more):
    assert main(["export", "--only", "nctf", *more, "--out", str(tmp_path)]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["nctf.fmu", "reference"]
    expected = reference_files(fmu_kernel("nctf"))
    written = {p.name.removeprefix("nctf"): p for p in (tmp_path / "reference").iterdir()}
    assert {suffix: p.read_text() for suffix, p in written.items()} == expected
