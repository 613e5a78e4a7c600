"""Dates and times of day as loggers write them."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.measurement.records.table import read_tables, rename
from ballscrew.solver.errors import BadRecord

X = ["1.5", "2.5", "4.0", "8.0"]


def read(tmp_path, stamps):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["time;x", *map(";".join, zip(stamps, X, strict=True)), ""]))
    return rename(read_tables(path)[0], {}, ["time", "x"], [])


@pytest.mark.parametrize(
    "stamps",
    [
        ["2024-03-01T12:00:00.000", "2024-03-01T12:00:00.250", "2024-03-01T12:00:00.5Z"],
        ["2024-03-01 12:00:00", "2024-03-01 12:00:00.25", "2024-03-01 12:00:00.50"],
        ["2024-02-29 23:59:59.9", "2024-03-01 00:00:00.15", "2024-03-01 00:00:00.4"],
        ["31.12.2023 23:59:59.8", "1.1.2024 00:00:00.05", "01.01.2024 00:00:00.3"],
        ["3/4/2024 11:59:59.900 AM", "3/4/2024 12:00:00.150 PM", "3/4/2024 12:00:00.4 PM"],
        ["23:59:59.75", "00:00:00.00", "00:00:00.25"],
        ["12:30:00.1+01:00", "12:30:00.35+01:00", "12:30:00.6+01:00"],
        ["59:59.5", "59:59.75", "60:00.0"],
    ],
)
def test_stamps_are_seconds_from_the_first_one(tmp_path, stamps):
    table = read(tmp_path, [*stamps, ""])
    np.testing.assert_allclose(table.columns["time"], [0, 0.25, 0.5, np.nan], atol=1e-9)
    assert table.units == {"time": "s"}
    assert table.notes == (f"time is in seconds from {stamps[0]}",)


@pytest.mark.ci
def test_stamps_with_decimal_commas_and_columns_without_a_name(tmp_path):
    stamps = ["01.03.2024 12:00:00,000", "01.03.2024 12:00:00,001", "", "01.03.2024 12:00:00,003"]
    rows = [f"{s};{x.replace('.', ',')}" for s, x in zip(stamps, X, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([";Weg (mm)", *rows, ""]))
    (table,) = read_tables(tmp_path / "a.csv")
    np.testing.assert_allclose(table.columns["1"], [0, 1e-3, np.nan, 3e-3], atol=1e-9)


@pytest.mark.ci
def test_days_and_months_that_may_be_either_are_refused(tmp_path):
    stamps = ["3/4/2024 23:59", "3/4/2024 23:59", "4/4/2024 00:00", "4/4/2024 00:01"]
    with pytest.raises(BadRecord, match=r"'3/4/2024 23:59' may be from two days; write dates as"):
        read(tmp_path, stamps)


@pytest.mark.ci
def test_a_cell_that_is_no_stamp_among_stamps_is_named_with_its_line(tmp_path):
    stamps = ["12:00:00", "noon", "12:00:02", "12:00:03"]
    with pytest.raises(BadRecord, match="row 3, column 'time': 'noon' is not a time of day"):
        read(tmp_path, stamps)
