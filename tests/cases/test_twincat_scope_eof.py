"""An export of TwinCAT's scope, with a line EOF behind the table."""

from __future__ import annotations

import pytest
from cases import case

from ballscrew import read_drive_records

BY_NUMBER = {"1": "time", "2": "x", "4": "u"}
BY_NAME = {"Axis.ActPos": "x", "Axis.Torque": "u"}


@pytest.mark.parametrize(
    ("mapping", "units"),
    [(BY_NUMBER, {"time": "ms", "x": "mm"}), (BY_NAME, {"time": "ms"})],
)
def test_the_rows_are_read_by_number_or_by_name_and_the_last_line_is_told(tmp_path, mapping, units):
    file = case("twincat_scope_eof", tmp_path) / "scope.csv"
    (record,) = read_drive_records([file], mapping, units)
    assert (record.step, len(record.time)) == (pytest.approx(1e-3), 1500)
    assert (record.x[1], record.u[1]) == pytest.approx((0.358127e-3, 3.984011))
    assert record.notes[0].startswith("1 invalid line of the table left out")
