"""What is wrong with a record has to be told from what is wrong with the drive."""

import math
import re

import pytest
from cases import case

from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import drive_of
from ballscrew.orchestration.parameter_reading import read_parameters
from ballscrew.records.reading import check_record, read_drive_records

LEAD = 0.001


def right(folder):
    """The record with the right voltage, and its model."""
    told = read_parameters(folder / "axis.toml").with_lead(LEAD)
    (record,) = read_drive_records([folder / "right.csv"], lead=LEAD)
    return record, drive_of(told, None)


@pytest.mark.ci
def test_the_line_to_line_voltage_taken_for_the_phases_is_named_with_its_size(tmp_path, command):
    folder = case("diagnose_voltage_scaled_none", tmp_path)
    words = "diagnose run.csv --params axis.toml --lead 0.001 --out out"
    code, printed, _ = command(folder, words)
    assert code == 0
    assert printed.startswith("explained: scale_of_u explains the error of the model")
    (size,) = re.findall(r"^  scale_of_u +([0-9.]+) ", printed, re.MULTILINE)
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
    assert found.left_of_friction > 0.5 or found.causes


@pytest.mark.ci
@pytest.mark.parametrize("rate", [50, pytest.param(200, marks=pytest.mark.ci)])
def test_a_white_force_under_a_heavy_friction_is_noise_in_newtons(tmp_path, rate):
    folder = case("heavy_friction_names_inertia", tmp_path)
    (record,) = read_drive_records([folder / f"f_m25_{rate}Hz.csv"])
    half = {n: s[: len(s) // 2] for n, s in record.signals.items()}  # twenty seconds are enough
    found = diagnose_records(
        [check_record("half", half)], drive_of(read_parameters(folder / "p25.toml"))
    )
    assert found.verdict == "none"
    assert found.causes == ()
    assert found.final_residual.force == pytest.approx(found.floor.force, rel=0.3)
    # means over windows have less than the 60 N of the samples
    assert 20.0 < found.final_residual.force < 60.0
