"""Angles and counters that begin anew go on, and what jumps otherwise stays as it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.measurement.records.reading import read_drive_records
from ballscrew.measurement.records.sampling import unwrapped

TIME = np.arange(0.0, 2.0, 1e-3)
LEAD = 0.005
X = 4 * LEAD * np.sin(3 * TIME)  # four turns each way
TURNS = X / LEAD


def read(folder, x, unit, time=TIME, time_unit="s"):
    table = np.column_stack([time, 3 * np.sin(5 * TIME), x])
    path = folder / "a.csv"
    np.savetxt(path, table, delimiter=",", header="time,u,x", comments="", fmt="%.12g")
    (record,) = read_drive_records([path], None, {"x": unit, "time": time_unit}, LEAD)
    return record


@pytest.mark.parametrize(
    ("unit", "turn", "half"),
    [("deg", 360.0, 0.5), ("rad", 2 * math.pi, 0.0), ("0.25*deg", 1440.0, 0.0)],
)
def test_angles_of_one_turn_go_on(tmp_path, unit, turn, half):
    record = read(tmp_path, turn * ((TURNS + half) % 1.0 - half), unit)
    np.testing.assert_allclose(record.x - record.x[0], X - X[0], atol=1e-9)
    (note,) = record.notes
    assert note.startswith("x jumps by a turn ")
    assert note.endswith(" times: it wraps around and was unwrapped")


@pytest.mark.parametrize("bits", [12, 14, 17, 32])
def test_counters_of_fixed_size_go_on(tmp_path, bits):
    count = 0.03 / 2**bits  # X moves over 0.04 m
    record = read(tmp_path, np.round(X / count) % 2**bits, f"{count}*m")
    np.testing.assert_allclose(record.x - record.x[0], X - X[0], atol=2 * count)
    assert f"x jumps by 2^{bits} " in record.notes[0]


def test_a_counter_of_time_goes_on(tmp_path):
    record = read(tmp_path, X, "m", (np.round(1e6 * TIME) + 2**32 - 5e5) % 2**32, "us")
    np.testing.assert_allclose(np.diff(record.time), 1e-3, rtol=1e-6)
    assert record.notes == ("time jumps by 2^32 1 times: it wraps around and was unwrapped",)


@pytest.mark.ci
def test_other_jumps_stay_as_they_are_and_samples_that_are_not_known_stay_so():
    x = 100 * np.sin(3 * TIME) + 150
    wrong, step = x.copy(), x.copy()
    wrong[700], step[700:] = 300.0, 300.0
    for values in (4 * x, wrong, step):
        assert unwrapped("x", values, 360.0)[1] == []
    x = 360 * (TURNS % 1.0)
    x[5::7] = np.nan
    out, notes = unwrapped("x", x, 360.0)
    assert notes
    np.testing.assert_array_equal(np.isnan(out), np.isnan(x))
    np.testing.assert_allclose(out[~np.isnan(out)], 360 * TURNS[~np.isnan(out)], atol=1e-9)
