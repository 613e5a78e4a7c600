"""A LabVIEW measurement file with two headers, decimal commas and a remark in its first row."""

from __future__ import annotations

import pytest
from cases import case

from ballscrew import read_drive_records


def test_the_rows_below_the_second_header_are_read(tmp_path):
    file = case("labview_lvm", tmp_path) / "run.lvm"
    mapping = {"X_Value": "time", "Position": "x", "Voltage": "u"}
    (record,) = read_drive_records([file], mapping, {"time": "s", "x": "m", "u": "V"})
    assert len(record.time) == file.read_text().count("\n") - 22 == 1500
    assert (record.x[1], record.u[0]) == pytest.approx((0.000358, 3.947092))
