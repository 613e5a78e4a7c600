"""The rig out of separate FMUs gives the record of the compiled one."""

import json

import numpy as np
import pytest

from ballscrew.fmus.reading import unpack
from ballscrew.orchestration.participant import StepFailed
from ballscrew.rig.bench import run_trial
from ballscrew.rig.fmu_bench import export_rig, run_trial_with_fmus


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    return export_rig(tmp_path_factory.mktemp("rig"))


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
