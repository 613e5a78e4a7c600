"""The rig out of separate FMUs gives the record of the compiled one."""

import json

import fmpy
import numpy as np
import pytest

from ballscrew import read_parameters
from ballscrew.orchestration.fmu_instance import FmuInstance
from ballscrew.rig.bench import run_trial
from ballscrew.rig.fmu_bench import export_trial
from ballscrew.rig.rig_wiring import WIRINGS

pytestmark = pytest.mark.ci


def repeated(folder):
    """Signals of what `export_trial` wrote, row by row, by a master that knows the files only."""
    about, wiring = (json.loads((folder / f"{n}.json").read_text()) for n in ("values", "wiring"))
    trial, step = wiring["trials"][about["control"]], wiring["step"]
    outside = np.genfromtxt(folder / "outside.csv", delimiter=",", names=True)
    parts = {n: FmuInstance(folder / f"{n}.fmu", n) for n in trial["order"]}
    now, rows, ports = {}, [], {}
    try:
        for name, part in parts.items():
            part.initialize(about["values"][name], about["duration"])
            targets = [t for t in trial["feeds"] if t.startswith(f"{name}.")]
            ports[name] = (
                part.writer([t.partition(".")[2] for t in targets]),
                [trial["feeds"][t] for t in targets],
                part.reader(part.outputs),
                [f"{name}.{output}" for output in part.outputs],
            )
        plant, (_, _, read_plant, of_plant) = parts["plant"], ports["plant"]
        for row in outside:
            now |= dict(zip(outside.dtype.names, row, strict=True))
            now |= dict(zip(of_plant, read_plant().tolist(), strict=True))
            for name, (write, sources, read, given) in ports.items():
                write(np.array([now[source] for source in sources]))
                if name != "plant":
                    parts[name].step(row["time"], step)
                now |= dict(zip(given, read().tolist(), strict=True))
            rows.append(dict(now))
            if row["time"] < about["duration"] - step / 2:
                plant.step(row["time"], step)
    finally:
        for part in parts.values():
            part.close()
    return {name: np.array([row[name] for row in rows]) for name in now}


@pytest.mark.parametrize(
    "trial",
    [
        ("2.4/1", "modified_lugre", {}, 2),
        pytest.param(
            ("loading-rate/20", "lugre", {"plant.Fs": 2.0, "encoder.counts": 2048.0}, 5),
            marks=pytest.mark.prove,
        ),
    ],
    ids=["velocity", "loading"],
)
def test_separate_fmus_give_the_same_record_and_truth(trial, tmp_path):
    """Readings agree exactly, the rest to round-off; the force is controlled below."""
    export_trial(tmp_path, *trial)
    apart, compiled = repeated(tmp_path), run_trial(*trial)
    wiring = WIRINGS[compiled.trial.control]
    taps = wiring.taps | {"u": wiring.command}
    for name, values in compiled.record.items():
        got, scale = apart[taps.get(name, name)], np.abs(values).max()
        np.testing.assert_allclose(got, values, atol=1e-12 * scale, rtol=0)
    for name, values in compiled.truth.items():
        source = {"time": "time", "u": "plant.voltage"}.get(name, f"plant.{name}")
        scale = np.abs(values).max()
        np.testing.assert_allclose(apart[source], values, atol=1e-10 * scale, rtol=0)


def test_separate_fmus_of_a_drive_have_its_units_and_give_the_same_record(tmp_path):
    path = tmp_path / "joint.toml"
    path.write_text('kind = "rotary_drive"\ncommand = "torque"\n[plant]\nJ = 0.5\n')
    given = ("2.2/5", "lugre", {}, 2)
    export_trial(tmp_path, *given, told=read_parameters(path))
    assert not (tmp_path / "capacitance_sensor.fmu").exists()
    units = {
        (part, v.name): v.unit
        for part in ("plant", "velocity_pid", "load_cell")
        for v in fmpy.read_model_description(str(tmp_path / f"{part}.fmu")).modelVariables
    }
    assert units["plant", "x"] == "rad"
    assert units["plant", "J"] == "kg*m^2"
    assert units["velocity_pid", "u"] == units["load_cell", "force"] == "N*m"
    compiled, apart = run_trial(*given, told=read_parameters(path)), repeated(tmp_path)
    for name, port in (("x", "plant.x"), ("force", "plant.force"), ("u", "plant.voltage")):
        true = compiled.truth[name]
        np.testing.assert_allclose(apart[port], true, atol=1e-10 * np.abs(true).max(), rtol=0)
