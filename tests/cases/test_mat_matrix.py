"""MAT-files of Simulink and dSPACE: matrices and arrays of structures."""

from __future__ import annotations

import numpy as np
import pytest
from cases import case

from ballscrew import read_drive_records
from ballscrew.records.bad_record import BadRecord

UNITS = {"time": "s", "x": "m", "u": "V"}
THEIRS = {
    "tofile": {"ans.1": "time", "ans.2": "x", "ans.3": "u"},
    "scope": {"pos": "x", "volt": "u"},
    "dspace": {"Pos": "x", "U": "u"},
}


def test_each_gives_the_same_record(tmp_path):
    folder = case("mat_matrix", tmp_path)
    read = [
        read_drive_records([folder / f"{n}.mat"], mapping, UNITS)[0]
        for n, mapping in THEIRS.items()
    ]
    for record in read:
        assert len(record.time) == 2000
        np.testing.assert_array_equal(record.x, read[0].x)
        np.testing.assert_array_equal(record.u, read[0].u)
    assert read[0].u[0] == pytest.approx(3.94709171)


def test_a_matrix_without_names_is_named_by_its_rows(tmp_path):
    with pytest.raises(BadRecord, match=r"has no column 'time'.*; there are ans.1, ans.2, ans.3"):
        read_drive_records([case("mat_matrix", tmp_path) / "tofile.mat"])
