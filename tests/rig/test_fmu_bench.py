"""The rig out of separate FMUs gives the record of the compiled one."""

import json

import numpy as np
import pytest

from ballscrew.fmus.reading import unpack
from ballscrew.orchestration.fmu_instance import FmuInstance, StepFailed
from ballscrew.rig.bench import run_trial
from ballscrew.rig.fmu_bench import export_rig, export_trial, run_trial_with_fmus


@pytest.fixture(scope="module")
def rig(once, tmp_path_factory):
    return once("FMUs of the rig", lambda: export_rig(tmp_path_factory.mktemp("rig")))


@pytest.mark.parametrize("trial", ["2.4/1", "2.8/4", "loading-rate/20"])
def test_separate_fmus_give_the_same_record_and_truth(rig, trial):
    """One of each kind of control. Readings agree exactly, the rest to round-off."""
    apart, compiled = run_trial_with_fmus(trial, rig, seed=2), run_trial(trial, seed=2)
    assert list(apart.record) == list(compiled.record)
    assert list(apart.truth) == list(compiled.truth)
    for name, values in compiled.record.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(apart.record[name], values, atol=1e-12 * scale, rtol=0)
    for name, values in compiled.truth.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(apart.truth[name], values, atol=1e-10 * scale, rtol=0)
    assert apart.parameters == compiled.parameters
    assert apart.notes == compiled.notes


def test_the_wiring_that_is_written_names_what_the_fmus_have(rig):
    written = json.loads((rig["plant"].parent / "wiring.json").read_text())
    assert written["step"] == 0.005
    ports = {}
    for name, path in rig.items():
        fmu = unpack(path)
        ports |= {f"{name}.{port}": "in" for port in fmu.description.names("input")}
        ports |= {f"{name}.{port}": "out" for port in fmu.description.names("output")}
        fmu.remove()
    for control, trial in written["trials"].items():
        for target, source in trial["feeds"].items():
            assert ports[target] == "in", control
            if "." in source:
                assert ports[source] == "out", control
                first, second = source.partition(".")[0], target.partition(".")[0]
                if first != "plant":
                    assert trial["order"].index(first) < trial["order"].index(second)


def test_what_is_exported_with_a_trial_repeats_it(tmp_path):
    """A master of a few lines, which knows the files only."""
    changed = {"plant.Fs": 2.0, "encoder.counts": 2048.0}
    export_trial(tmp_path, "loading-rate/20", "lugre", changed, seed=5)
    about = json.loads((tmp_path / "values.json").read_text())
    wiring = json.loads((tmp_path / "wiring.json").read_text())
    trial, step = wiring["trials"][about["control"]], wiring["step"]
    names = (tmp_path / "outside.csv").read_text().partition("\n")[0].split(",")
    outside = np.loadtxt(tmp_path / "outside.csv", delimiter=",", skiprows=1)
    parts = {n: FmuInstance(tmp_path / f"{n}.fmu", n) for n in trial["order"]}
    now, force = {}, []
    try:
        for name, part in parts.items():
            part.initialize(about["values"][name], about["duration"])
        plant = parts["plant"]
        read = plant.reader(["x", "force"])
        for row in outside:
            now |= dict(zip(names, row, strict=True))
            now |= dict(zip(("plant.x", "plant.force"), read(), strict=True))
            for name, part in parts.items():
                feeds = {t: s for t, s in trial["feeds"].items() if t.startswith(f"{name}.")}
                ports = [target.partition(".")[2] for target in feeds]
                part.writer(ports)(np.array([now[s] for s in feeds.values()]))
                if name != "plant" or row[0] < about["duration"] - step / 2:
                    part.step(row[0], step)
                if name != "plant":
                    outputs = (f"{name}.{o}" for o in part.outputs)
                    now |= dict(zip(outputs, part.reader(part.outputs)(), strict=True))
            force.append(now["acquisition.force"])
    finally:
        for part in parts.values():
            part.close()
    expected = run_trial("loading-rate/20", "lugre", changed, seed=5)
    np.testing.assert_allclose(force, expected.record["force"], atol=1e-12)


def test_a_part_that_refuses_its_parameter_says_so(rig, monkeypatch):
    from ballscrew.rig import fmu_bench

    def spoilt(*arguments):
        setup = set_up(*arguments)
        setup.parameters["load_cell.resolution"] = -1.0
        return setup

    set_up = fmu_bench.set_up
    monkeypatch.setattr(fmu_bench, "set_up", spoilt)
    with pytest.raises(StepFailed, match="resolution = -1 N is out of its range"):
        run_trial_with_fmus("2.8/1", rig)
