"""What is wrong with a record has to be told from what is wrong with the drive."""

import json
import math
import re

import pytest
from case_inputs import karnopp_step, lead_screw
from cases import case
from pyarrow.parquet import read_table

from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.model import drive_of
from ballscrew.measurement.records.reading import check_record, read_drive_records
from ballscrew.orchestration.loop.parameter_file import read_parameters

LEAD = 0.001


def right(folder):
    """The record with the right voltage, and its model."""
    told = read_parameters(folder / "axis.toml").with_lead(LEAD)
    (record,) = read_drive_records([folder / "right.csv"], lead=LEAD)
    return record, drive_of(told, None)


SCREW = "--map Zeit=time --map Istposition=x --map Drehmoment=u --lead 0.005"


def drift(coulomb):
    """Root mean square drift within a second of a screw with this friction, by own integration."""
    _, x, torque, v = lead_screw()
    off = []
    for k, (place, held) in enumerate(zip(x, torque, strict=True)):
        if k % 1000 == 0:
            at, speed = place, v[k]
        off.append(at - place)
        for _ in range(10):
            at, speed = karnopp_step(at, speed, held * 2e3 * math.pi / 5, 1e-4, 60.0, coulomb, 1.0)
    return math.sqrt(sum(o * o for o in off) / len(off))


@pytest.mark.ci
def test_both_commands_predict_the_drift_that_an_own_integration_has(tmp_path, command):
    folder = case("own_machine", tmp_path)
    words = f"rec.csv {SCREW} --params weak.toml --json"
    known = drift(88.0)
    _, printed, _ = command(folder, f"compare {words}")
    compared = json.loads(printed)["models"]["model"]["all"]
    assert compared["position"]["value_m"] == pytest.approx(known, rel=0.02)
    _, printed, _ = command(folder, f"diagnose {words} --out out")
    told = json.loads(printed)
    prior, fitted = told["baseline_residual"], told["adjusted_residual"]
    assert prior["position_m"] == pytest.approx(compared["position"]["value_m"], rel=1e-9)
    assert prior["force_N"] == pytest.approx(compared["force"]["value_N"], rel=1e-9)
    assert fitted["position_m"] < 0.2 * known


@pytest.mark.ci
@pytest.mark.parametrize(
    ("record", "cause", "size", "truth"),
    # 90 N forwards and 103.5 N backwards: 7 % of their mean
    [("asym", "direction_asymmetry", "asymmetry", -0.07), ("heavy", "unmodelled_inertia", "m", 72)],
)
def test_a_wrong_value_of_an_own_machine_is_explained_in_forces_that_it_can_have(
    tmp_path, command, record, cause, size, truth
):
    folder = case("own_machine", tmp_path)
    words = f"diagnose {record}.csv {SCREW} --params right.toml --json --out out"
    code, printed, _ = command(folder, words)
    told = json.loads(printed)
    assert (code, told["verdict"]) == (0, "explained")
    found = {c["name"]: c for c in (*told["causes"], *told["suspects"])}
    values = found[cause]["parameters"]
    assert values.get(size, values.get(f"dry_{size}")) == pytest.approx(truth, rel=0.06)
    assert told["final_residual"]["force_N"] < 1.3 * told["floor"]["force_N"]
    assert max(c["force"] for c in found.values()) < 100.0  # of a friction of 120 N
    curves = read_table(folder / "out" / "curves.parquet").to_pydict()
    assert max(abs(f) for name in ("cause", "shape") for f in curves[name] if f == f) < 100.0


@pytest.mark.ci
def test_the_line_to_line_voltage_taken_for_the_phases_is_named_with_its_size(tmp_path, command):
    folder = case("diagnose_voltage_scaled_none", tmp_path)
    words = "diagnose run.csv --params axis.toml --lead 0.001 --out out"
    code, printed, _ = command(folder, words)
    assert code == 0
    assert printed.startswith("cause found: scale_of_u (scale_of_u = ")
    (size,) = re.findall(r"scale_of_u = ([0-9.]+) \(", printed)
    assert float(size) == pytest.approx(1.0 / math.sqrt(3.0), rel=0.01)
    assert (folder / "out" / "report.html").is_file()


@pytest.mark.ci
def test_the_right_voltage_is_nothing(tmp_path):
    record, model = right(case("diagnose_voltage_scaled_none", tmp_path))
    found = diagnose_records([record], model)
    assert found.verdict == "none"
    assert found.final_residual.force < 2.0 * found.floor.force < 0.2 * model.friction_scale


@pytest.mark.ci
@pytest.mark.parametrize(
    ("column", "factor"),
    [("u", 0.1), ("u", 0.5), ("u", 1.2), ("u", 10.0), ("i", 10.0), ("R", 1 / 3)],
)
def test_neither_a_scale_nor_a_resistance_that_is_wrong_is_nothing(tmp_path, column, factor):
    record, model = right(case("diagnose_voltage_scaled_none", tmp_path))
    signals = dict(record.signals)
    if column == "R":
        model = model.changed({"R": factor * model.values["R"]})
    else:
        signals[column] = factor * signals[column]
    found = diagnose_records([check_record("scaled", signals)], model)
    assert found.verdict != "none"
    certain = [c.name for c in found.causes if c.certain]
    if column == "i":  # which the motor's force is not taken from then
        assert certain == ["scale_of_i"]
    else:
        assert set(certain) <= {"scale_of_u" if column == "u" else "parameter_error"}
        assert found.adjusted_residual.force > 10.0 * found.floor.force
    assert found.final_residual.force > 0.5 * found.friction or found.causes


@pytest.mark.ci
@pytest.mark.parametrize("rate", [50, pytest.param(200, marks=pytest.mark.ci)])
def test_a_white_force_under_a_heavy_friction_is_noise_in_newtons(tmp_path, rate):
    folder = case("heavy_friction_names_inertia", tmp_path)
    (record,) = read_drive_records([folder / f"f_m25_{rate}Hz.csv"])
    half = {n: s[: len(s) // 2] for n, s in record.signals.items()}  # twenty seconds are enough
    found = diagnose_records(
        [check_record("half", half)], drive_of(read_parameters(folder / "p25.toml"))
    )
    assert found.verdict == "undecided"  # white noise of a force, averaged by a shift, scores
    assert found.causes == ()
    assert found.final_residual.force == pytest.approx(found.floor.force, rel=0.3)
    # means over windows have less than the 60 N of the samples
    assert 20.0 < found.final_residual.force < 60.0
