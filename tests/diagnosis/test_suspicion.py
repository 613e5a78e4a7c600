"""Sets of suspects: what is in them, with its size, and what a user does with one."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from axis_records import gap, strong_record, write_strong
from cases import case
from diagnosed import nominal, run
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import layout as at

from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import drive_of, read_drive
from ballscrew.diagnosis.sets import probabilities
from ballscrew.orchestration.parameter_reading import read_parameters
from ballscrew.records.reading import check_record, read_drive_records

LEAD = 0.001


@cache
def found_in(*changes):
    return diagnose_records([strong_record(dict(changes))], nominal())


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_probabilities_are_shares_of_one(count, seed):
    random = np.random.default_rng(seed)
    rows, weights = 100 * random.standard_normal((count, 4)), random.standard_normal(4)
    names = [f"n{k}" for k in range(count)]
    found = probabilities(names, rows, weights, {"n0": (3.0, 0.0, 0.0)})
    assert found.sum() == pytest.approx(1.0)
    assert np.all(found >= 0.0)


def test_of_a_record_without_a_fault_nothing_is_ruled_out():
    found = found_in()
    assert found.verdict == "none"
    assert found.suspects == ()


@pytest.mark.parametrize(
    ("changes", "name", "value", "size"),
    [
        (((at.LOAD, 0.4),), "load_bias", "load", 0.4),
        (tuple(gap(1e-4).items()), "backlash", "gap", 1e-4),
    ],
)
def test_a_strong_effect_is_in_the_set_with_its_size(changes, name, value, size):
    found = found_in(*changes)
    assert found.verdict != "none"
    (one,) = (s for s in (*found.causes, *found.suspects) if s.name == name)
    low, high = one.intervals[value]
    assert 0.9 * low <= size <= 1.1 * high
    assert one.parameters[value] == pytest.approx(size, rel=0.15)
    assert one.of_friction > 0.02
    assert one.force > 0.0


@pytest.mark.parametrize("factor", [0.5, 3**0.5, 10.0])
def test_a_voltage_at_another_scale_is_a_suspect_with_its_factor(tmp_path, factor):
    folder = case("diagnose_voltage_scaled_none", tmp_path)
    told = read_parameters(folder / "axis.toml").with_lead(LEAD)
    (record,) = read_drive_records([folder / "right.csv"], lead=LEAD)
    signals = {**record.signals, "u": factor * record.signals["u"]}
    found = diagnose_records([check_record("scaled", signals)], drive_of(told, None))
    scale = (*found.causes, *found.suspects)[0]
    assert scale.name == "scale_of_u"
    assert scale.parameters["scale_of_u"] == pytest.approx(1 / factor, rel=0.1)


@pytest.mark.parametrize("rate", [50, 200])
def test_noise_under_a_heavy_friction_is_no_mass(tmp_path, rate):
    folder = case("heavy_friction_names_inertia", tmp_path)
    records = read_drive_records([folder / f"f_m25_{rate}Hz.csv"])
    found = diagnose_records(records, read_drive(folder / "p25.toml"))
    assert found.causes == ()
    assert "unmodelled_inertia" not in {s.name for s in found.suspects}
    assert found.verdict == "none"


def test_a_cause_is_built_in_that_the_user_takes(tmp_path):
    record, believed = write_strong({at.LOAD: 0.4}, tmp_path)
    given = ("diagnose", record, "--params", believed, "--out", tmp_path / "out")
    code, printed, _ = run(*given, "--take", "direction_asymmetry")
    told = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert "direction_asymmetry" in [c["name"] for c in told["causes"]]
    assert (tmp_path / "out" / "extended_plant.fmu").is_file()
    assert "direction_asymmetry: " in printed
    assert code in (0, 1)


def test_what_is_no_cause_cannot_be_taken(tmp_path):
    record, believed = write_strong({at.LOAD: 0.4}, tmp_path)
    given = ("diagnose", record, "--params", believed, "--out", tmp_path / "out")
    code, _, said = run(*given, "--take", "backlsh")
    assert code == 2
    assert "backlash" in said
    assert not (tmp_path / "out").exists()
