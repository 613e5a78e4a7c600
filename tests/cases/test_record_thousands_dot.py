"""A dot in a file of decimal commas stands between thousands, never before decimals."""

from __future__ import annotations

import numpy as np
import pytest
from cases import case

from ballscrew import read_drive_records


def test_micrometres_from_a_thousand_on_are_read_as_written(tmp_path):
    file = case("record_thousands_dot", tmp_path) / "run.csv"
    (record,) = read_drive_records([file], None, {"x": "um"})
    assert np.abs(record.x).max() == pytest.approx(0.019882, abs=1e-9)
    whole = [int(row.split(";")[1].replace(".", "")) for row in file.read_text().split()[1:]]
    np.testing.assert_allclose(record.x, 1e-6 * np.array(whole), atol=1e-15)
