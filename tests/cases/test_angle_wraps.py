"""An angle of 0 to 360 degrees, over many turns."""

from __future__ import annotations

import numpy as np
from cases import case

from ballscrew import read_drive_records


def test_an_angle_that_wraps_goes_on_and_it_is_said(tmp_path):
    file = case("angle_wraps", tmp_path) / "run.csv"
    (record,) = read_drive_records([file], lead=0.001)
    assert any("wraps around and was unwrapped" in note for note in record.notes)
    assert np.abs(np.diff(record.x)).max() < 0.1e-3  # no step of a tenth of a turn is left
    angle = np.loadtxt(file, delimiter=",", skiprows=1, usecols=1)
    turns = (record.x * 360e3 - angle) / 360
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
