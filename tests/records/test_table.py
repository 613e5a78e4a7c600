"""Tables as machines write them: found in the text, whatever is around and between the numbers."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io

from ballscrew.records.bad_record import BadRecord
from ballscrew.records.table import read_table

ROWS = np.array([[0.0, -1.5, 0.25], [0.001, 2.25, 0.5], [0.002, 3e-4, -0.75], [0.003, 7.0, 1.0]])
# As a motor controller exports a recording: lines about itself, then names, then units.
EXPORT = """Date:;2024-03-01 10:11:12
Firmware:;0x0120;0x6150;0x0000
Max. samples:;500
Scale:;0;True;20.000;-1.000;-79.000;81.000
"Trigger:;1;0.000000;""Parameter values"";""Channel 1"";""Rising above value\"""
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%
0.000;-1;-32.8
128.000;-7;-22.8
256.000;-1;-25.6
384.000;-1;-31.4
"""


def write(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return path


def body(separator, decimal=".", end=""):
    lines = [separator.join(str(v).replace(".", decimal) for v in row) + end for row in ROWS]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("header", "separator", "decimal", "end"),
    [
        ("time,u,x\n", ",", ".", ""),
        ("time;u;x\n", ";", ".", ""),
        ("time;u;x\n", ";", ",", ""),
        ("time\tu\tx\n", "\t", ",", ""),
        ("time u x\n", " ", ".", ""),
        ("time;u;x;\n", ";", ",", ";"),
        ("time;u;x\n", ";", ",", ";"),
        ("time,u,x,\n", ",", ".", ","),
        ("time;u;x,,\n", ";", ".", ",,"),
        ('"time";"u";"x"\n', ";", ",", ""),
        ("\n\ntime, u, x\n\n", ",", ".", ""),
        ("Machine 7;;\nrun;of;today\ntime;u;x\n", ";", ".", ""),
    ],
)
def test_separators_decimal_commas_and_ends_of_lines_are_found(
    tmp_path, header, separator, decimal, end
):
    table = read_table(write(tmp_path, header + body(separator, decimal, end)))
    assert list(table.columns) == ["time", "u", "x"]
    np.testing.assert_array_equal(np.column_stack(list(table.columns.values())), ROWS)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_names_with_signs_of_any_encoding_are_read(tmp_path, encoding):
    path = write(tmp_path, "Zeit;Größe;Weg (µm)\n" + body(";", ","), encoding)
    table = read_table(path)
    assert list(table.columns) == ["Zeit", "Größe", "Weg"]
    assert table.units == {"Weg": "µm"}


def test_a_controllers_export_has_its_names_units_and_line_numbers(tmp_path):
    table = read_table(write(tmp_path, EXPORT.replace("\n", "\r\n")))
    torque = "Torque actual value averaged"
    assert table.units == {"1": "ms", "Velocity actual value averaged": "rpm", torque: "%"}
    np.testing.assert_array_equal(table.columns["1"], [0, 128, 256, 384])
    np.testing.assert_array_equal(table.columns[torque], [-32.8, -22.8, -25.6, -31.4])
    assert table.row(0) == 8


def test_a_cell_that_somebody_changed_by_hand_is_named_with_its_line(tmp_path):
    path = write(tmp_path, EXPORT.replace("-32.8", "-1200,,was -8.9"))
    with pytest.raises(BadRecord, match=r"row 8, column 'Torque .*'-1200,,was -8.9' is no number"):
        read_table(path)


def test_units_stand_in_brackets_after_names_or_below_them(tmp_path):
    below = read_table(write(tmp_path, "t;u;x\n[ms];[V];[mm]\n" + body(";")))
    beside = read_table(write(tmp_path, "t [ms];u (V);x [mm]\n" + body(";")))
    assert below.units == beside.units == {"t": "ms", "u": "V", "x": "mm"}
    assert list(below.columns) == list(beside.columns) == ["t", "u", "x"]


def test_columns_of_words_are_left_out_and_empty_cells_are_no_numbers(tmp_path):
    lines = ["time;state;x", "0,0;run;1,5", "0,1;run;", "0,2;stop;2,5"]
    table = read_table(write(tmp_path, "\n".join(lines)))
    assert list(table.columns) == ["time", "x"]
    np.testing.assert_array_equal(table.columns["x"], [1.5, np.nan, 2.5])


def test_columns_without_names_go_by_their_number(tmp_path):
    assert list(read_table(write(tmp_path, body("\t"))).columns) == ["1", "2", "3"]


def test_commas_between_numbers_and_in_them_are_told_apart_from_a_broken_row(tmp_path):
    lines = ["time,x", *(f"0,{k},1,{k}" for k in range(10))]
    with pytest.raises(BadRecord, match="commas both between numbers and in them"):
        read_table(write(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("text", ["nothing but words\nand more\n", "PK\0\1\2"])
def test_what_is_no_table_is_said(tmp_path, text):
    with pytest.raises(BadRecord, match=r"no rows of numbers|no text table"):
        read_table(write(tmp_path, text))


def test_structures_in_mat_files_give_their_fields(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"data": {"t": ROWS[:, 0], "x": ROWS[:, 2]}, "note": "run 7"})
    table = read_table(path)
    assert list(table.columns) == ["data.t", "data.x"]
    np.testing.assert_array_equal(table.columns["data.x"], ROWS[:, 2])
