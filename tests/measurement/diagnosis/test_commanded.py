"""A ball screw of which only the current is known: the same motion by the motor's force."""

import dataclasses
import math

import numpy as np
import pytest
from axis_records import NOMINAL, TURN, friction_noise, moved, signals_of
from diagnosed import nominal

from ballscrew import diagnose
from ballscrew.measurement.diagnosis.balance import residual
from ballscrew.measurement.diagnosis.compare import compare_records
from ballscrew.measurement.diagnosis.corrected import corrected
from ballscrew.measurement.diagnosis.model import commanded, driven_by_current
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.records.reading import check_record
from ballscrew.measurement.records.record import CURRENT
from ballscrew.orchestration.loop.parameter_file import read_parameters
from ballscrew.solver.errors import BadRecord

pytestmark = pytest.mark.ci


LOAD = 0.6


def loaded(seed):
    time = np.arange(16_000) * 1e-3
    u = 3.0 * np.sin(2 * math.pi * 0.6 * time) + 1.5 * np.sin(2 * math.pi * 1.7 * time + 1)
    return signals_of(moved({"load": LOAD}, u, friction_noise(seed, len(u))), u)


@pytest.fixture(scope="module")
def signals():
    return loaded(seed=2)


def without(signals, name):
    return {n: s for n, s in signals.items() if n != name}


def test_the_gain_is_the_motors_force_per_ampere_and_the_mass_all_that_moves():
    screw = dataclasses.replace(nominal(), tolerance={**nominal().tolerance, "kt": 0.1, "Jm": 0.2})
    drive = driven_by_current(screw)
    assert (drive.kind, drive.law) == ("drive", "modified_lugre")
    assert drive.values["gain"] == pytest.approx(37.4e-3 * TURN)
    assert drive.values["m"] == pytest.approx(1.0 + 4.2e-7 * TURN**2)
    assert drive.tolerance["gain"] == 0.1
    rotor = 4.2e-7 * TURN**2
    assert drive.tolerance["m"] == pytest.approx((0.03 + 0.2 * rotor) / (1.0 + rotor))
    assert drive.values["sigma0"] == screw.values["sigma0"]
    assert not {"R", "L", "kt", "ke", "Jm", "p"} & set(drive.values)


def test_the_current_leaves_the_same_residual_as_the_voltage(signals):
    """The load is what both balances miss: only what they take for the motor's force differs."""
    left = []
    for record in (check_record("both", signals), check_record("current", without(signals, "u"))):
        (record,), model, _ = commanded([record], nominal())
        found = residual([lay_along(record, model)], model)
        left.append(float(np.mean(found.force[found.telling])))
    # minus the force that opposes motion in +x
    assert np.abs(left) == pytest.approx(LOAD, rel=0.05)
    assert left[0] == pytest.approx(left[1], rel=0.05)


def test_current_alone_is_diagnosed_and_compared_in_any_units(signals, tmp_path):
    """Milliamperes and degrees, with the lead: what is left is the load, in newtons."""
    lead = 1e-3
    table = [1e3 * signals["time"], 1e3 * signals["i"], 360 * signals["x"] / lead]
    path = tmp_path / "export.csv"
    np.savetxt(path, np.column_stack(table), delimiter=",", header="time,i,x", comments="")
    params = tmp_path / "screw.toml"
    values = {n: v for n, v in NOMINAL.items() if n != "p"}
    params.write_text("[plant]\n" + "\n".join(f"{n} = {v!r}" for n, v in values.items()))
    found = diagnose([path], params, units={"time": "ms", "i": "mA", "x": "deg"}, lead=lead)
    assert found.prior.kind == "drive"
    assert found.command == CURRENT
    assert found.baseline_residual.force == pytest.approx(LOAD, rel=0.1)
    assert "the current is the command of a drive" in found.notes[0]

    written = corrected(found, None, read_parameters(params)).save(tmp_path)
    file = read_parameters(written)
    assert (file.kind, file.diagnosis.command) == ("drive", CURRENT)
    assert "kt" not in file.plant
    # another record, with the voltage beside: the current counts
    other = check_record("other", loaded(seed=5))
    models = compare_records([other], file).models
    assert models["prior"]["all"].force.value == pytest.approx(LOAD, rel=0.1)
    gaps = without(other.signals, "u")
    gaps["i"] = np.where(other.time < 1.0, np.nan, gaps["i"])
    with pytest.raises(BadRecord, match="there is no command u, and the current i has gaps"):
        compare_records([dataclasses.replace(other, signals=gaps, command=CURRENT)], file)
    with pytest.raises(BadRecord, match="u is a voltage, and the drive is driven by a current"):
        compare_records([check_record("voltage", without(other.signals, "i"))], file)
