"""A unit in brackets behind a name is the file's word for the unit, known or not."""

from __future__ import annotations

import numpy as np
import pytest
from cases import case

from ballscrew import read_drive_records
from ballscrew.records.bad_record import BadRecord

INCH = 0.0254


def test_inches_in_brackets_become_metres(tmp_path):
    file = case("record_unit_in_brackets_unknown", tmp_path) / "run.csv"
    inches = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1]
    for mapping in (None, {"x [in]": "x"}):
        (record,) = read_drive_records([file], mapping)
        assert np.abs(record.x).max() == pytest.approx(0.0199, abs=1e-4)
        np.testing.assert_allclose(record.x, INCH * inches, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("unit", ["turns", "digits", "%", "rad/s"])
def test_any_other_word_there_is_refused_with_what_to_say(tmp_path, unit):
    file = case("record_unit_in_brackets_unknown", tmp_path) / "run.csv"
    file.write_text(file.read_text().replace("[in]", f"[{unit}]"))
    with pytest.raises(BadRecord, match=f"x is in '{unit}'; use --unit x= with one of m, "):
        read_drive_records([file], {f"x [{unit}]": "x"})
    (record,) = read_drive_records([file], None, {"x": "in"})
    assert np.abs(record.x).max() == pytest.approx(0.0199, abs=1e-4)
