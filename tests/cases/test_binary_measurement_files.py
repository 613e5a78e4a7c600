"""Measurement formats are told by their first bytes, also where the file is damaged."""

from __future__ import annotations

import pytest
from cases import ballscrew, case

from ballscrew import read_drive_records
from ballscrew.records.bad_record import BadRecord

NAMES = {"a.h5": "an HDF5", "a.mf4": "an MDF", "a.tdms": "a TDMS", "a.xlsx": "an Excel workbook"}


@pytest.mark.parametrize(("file", "name"), NAMES.items())
def test_a_damaged_file_is_called_by_its_format_with_what_to_save(tmp_path, file, name):
    folder = case("binary_measurement_files", tmp_path)
    with pytest.raises(BadRecord, match=f"is {name} .*; save it as .*CSV$") as caught:
        read_drive_records([folder / file])
    assert "\n" not in str(caught.value)


def test_the_command_says_it_in_one_line(tmp_path):
    folder = case("binary_measurement_files", tmp_path)
    (folder / "axis.toml").write_text('kind = "ball_screw"\nlaw = "lugre"\n')
    done = ballscrew(folder, "diagnose a.xlsx --params axis.toml --out out")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "a.xlsx: is an Excel workbook that cannot be read" in line
