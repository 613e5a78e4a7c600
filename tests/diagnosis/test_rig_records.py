"""Records of the virtual rig, closed loop and all: what was put in comes out."""

from __future__ import annotations

import pytest

from ballscrew.diagnosis.identification import identify
from ballscrew.diagnosis.records import read_records
from ballscrew.rig.bench import run_trial
from ballscrew.rig.trials import trials_named


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Constant velocities and slow sines in either direction, as ``ballscrew rig`` writes them."""
    path = tmp_path_factory.mktemp("rig")
    names = ["2.3.1", *(f"2.4/{k}" for k in (1, 3, 5, 7, 9, 11, 13, 15))]
    for trial in (t for name in names for t in trials_named(name)):
        run_trial(trial, "modified_lugre", {}, seed=1).save(path / trial.folder)
    return path


def test_the_rig_s_parameters_come_back_within_their_intervals(folder):
    records = read_records([folder])
    truth = records[0].about["parameters"]
    assert records[0].mass == truth["plant.m"]
    result = identify(records, "modified_lugre")
    for name, i in result.parameters.items():
        if name != "sigma1":
            assert i.identified, name
        low, high = i.low or 0.0, i.high or float("inf")
        assert low <= truth[f"plant.{name}"] <= high, name
    assert not result.parameters["sigma1"].identified
    assert [d.split(":")[0] for d in result.doubts] == ["sigma1"]
    assert not any("directions differ" in n for n in result.notes)
