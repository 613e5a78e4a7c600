"""Time as dates of ISO 8601."""

from __future__ import annotations

import numpy as np
from cases import case

from ballscrew import read_drive_records


def test_dates_are_seconds_from_the_first_one(tmp_path):
    (record,) = read_drive_records([case("time_as_date", tmp_path) / "run.csv"])
    np.testing.assert_allclose(record.time, 1e-3 * np.arange(len(record.time)), atol=1e-9)
    assert record.notes == ("time is in seconds from 2024-03-01T12:00:00.000000",)
