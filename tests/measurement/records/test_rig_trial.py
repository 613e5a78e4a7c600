"""What a rig says of its trial goes with its record of force, and not with that of a drive."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ballscrew.measurement.records.reading import read_drive_records, read_force_records
from ballscrew.solver.errors import BadRecord

ABOUT = {"parameters": {"plant.m": 1.5}, "lags": {"x": 0.0, "force": 0.002}}


@pytest.fixture
def folder(tmp_path):
    time = 0.005 * np.arange(300)
    table = np.column_stack([time, 1e-3 * (1 - np.cos(time)), np.sin(3 * time), np.sin(time)])
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        np.savetxt(
            tmp_path / name / "record.csv",
            table,
            delimiter=",",
            header="time,x,force,u",
            comments="",
        )
        (tmp_path / name / "trial.json").write_text(json.dumps(ABOUT))
    return tmp_path


def test_a_rig_folder_gives_mass_and_lags_and_a_folder_of_them_gives_all(folder):
    records = read_force_records([folder])
    assert len(records) == 2
    assert records[0].mass == 1.5
    assert records[0].lags["force"] == 0.002
    assert records[0].notes == ()
    assert read_force_records([folder], mass=2.5)[0].mass == 2.5
    assert [r.name for r in read_drive_records([folder])] == [r.name for r in records]


def test_a_file_without_a_trial_is_said_to_have_none(folder):
    (record,) = read_force_records([folder / "one" / "record.csv"])
    assert (record.mass, record.lags) == (1.0, {})
    assert any("no trial.json" in note for note in record.notes)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[", "is not JSON"),
        ("[]", "expected a JSON object"),
        ('{"lags": 3}', "expected `lags` to give a number of seconds"),
        ('{"parameters": {"plant.m": -1}}', "expected `plant.m` to be a finite mass"),
    ],
)
def test_what_no_rig_writes_is_refused(folder, text, words):
    (folder / "two" / "trial.json").write_text(text)
    with pytest.raises(BadRecord, match=words):
        read_force_records([folder])
    assert len(read_drive_records([folder])) == 2
