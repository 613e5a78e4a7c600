"""A signal at a wrong scale leaves far more than noise, and is never called nothing."""

from __future__ import annotations

import math
import re

import pytest
from cases import ballscrew, case

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


def test_the_line_to_line_voltage_taken_for_the_phases_is_named_with_its_size(tmp_path):
    folder = case("diagnose_voltage_scaled_none", tmp_path)
    done = ballscrew(folder, "diagnose run.csv --params axis.toml --lead 0.001 --out out")
    assert done.returncode == 0
    assert done.stdout.startswith("explained: scale_of_u explains the error of the model")
    (size,) = re.findall(r"^  scale_of_u +([0-9.]+) ", done.stdout, re.MULTILINE)
    assert float(size) == pytest.approx(1.0 / math.sqrt(3.0), rel=0.01)
    assert (folder / "out" / "report.html").is_file()


def test_the_right_voltage_is_nothing(tmp_path):
    record, model = right(case("diagnose_voltage_scaled_none", tmp_path))
    found = diagnose_records([record], model)
    assert found.verdict == "none"
    assert found.final_residual.force < 2.0 * found.floor.force < 0.2 * model.friction_scale


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
        assert set(certain) <= {"scale_of_u"} if column == "u" else {"parameter_error"}
        assert found.adjusted_residual.force > 10.0 * found.floor.force
    assert found.left_of_friction > 0.5 or found.causes
