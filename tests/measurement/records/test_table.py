"""Tables as machines write them: found in the text, whatever is around and between the numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.measurement.records.columns import Table
from ballscrew.measurement.records.reading import read_drive_records
from ballscrew.measurement.records.table import choose, in_si, read_tables, rename
from ballscrew.solver.errors import BadRecord

ROWS = np.array([[0.0, -1.5, 0.25], [0.001, 2.25, 0.5], [0.002, 3e-4, -0.75], [0.003, 7.0, 1.0]])


def read_table(path):
    (table,) = read_tables(path)
    return table


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
        ("time;u;x\n", ";", ",", ""),
        ("time\tu\tx\n", "\t", ",", ""),
        ("time u x\n", " ", ".", ""),
        ("time;u;x;\n", ";", ",", ";"),
        ("time;u;x,,\n", ";", ".", ",,"),
        ('"time";"u";"x"\n', ";", ",", ""),
        ("Machine 7;;\nrun;of;today\ntime;u;x\n", ";", ".", ""),
        ("# logger 3\n#time u x\n", " ", ".", ""),
        ("# logger 3\n# time,u,x\n", ",", ".", ""),
        ("# logger 3\ntime|u|x\n", "|", ".", ""),
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
    table = read_table(write(tmp_path, "Zeit;Größe;Weg (µm)\n" + body(";", ","), encoding))
    assert list(table.columns) == ["Zeit", "Größe", "Weg"]
    assert table.units == {"Weg": "µm"}


def test_columns_that_differ_by_their_brackets_alone_keep_them_and_their_units(tmp_path):
    table = read_table(write(tmp_path, "t [s];x [mm];x [in]\n" + body(";")))
    assert table.units == {"t": "s", "x [mm]": "mm", "x [in]": "in"}
    needed = [("x",)]
    mapped = rename(table, {"x [in]": "x"}, ["x"], needed)
    np.testing.assert_array_equal(mapped.columns["x"], ROWS[:, 2])
    assert mapped.units == {"x": "in"}
    for mapping in ({}, {"x [um]": "x"}):
        with pytest.raises(BadRecord, match=r"no column .*there are t, x \[mm\], x \[in\]"):
            rename(table, mapping, ["x"], needed)


def german(value, places):
    """A number with a decimal comma, and a dot between each three digits before it."""
    text = f"{value:,.{places}f}"
    return text.replace(",", "_").replace(".", ",").replace("_", ".")


@pytest.mark.ci
@given(values=st.lists(st.floats(-1e7, 1e7), min_size=6, max_size=30), places=st.integers(0, 4))
def test_dots_among_decimal_commas_are_of_thousands_or_refused(tmp_path_factory, values, places):
    texts = [german(v, places) for v in values]
    rows = [f"{k},5;{t}" for k, t in enumerate(texts)]
    path = write(tmp_path_factory.mktemp("dots"), "\n".join(["t;x", *rows]))
    if places == 0 and all(t.count(".") == 1 for t in texts):
        with pytest.raises(BadRecord, match=f"column 'x': '{texts[0]}' has a dot; the file has"):
            rename(read_table(path), {}, ["x"], [])
        return
    found = read_table(path).columns["x"]
    np.testing.assert_array_equal(found, [float(f"{v:.{places}f}") for v in values])


@pytest.mark.ci
@pytest.mark.parametrize("cell", ["0.5", "1234.567", "1.5e-3"])
def test_a_decimal_point_among_decimal_commas_is_refused_with_its_line(tmp_path, cell):
    rows = [f"0,{k:02d};{k}" for k in range(20)]
    rows[12] = f"0,12;{cell}"
    row = f"row 14, column 'x': '{cell}' is not a number; the file has decimal commas"
    whole = f"column 'x': '{cell}' has a dot"
    for lines, words in ((rows, row), ([f"0,{k:02d};{cell}" for k in range(20)], whole)):
        table = read_table(write(tmp_path, "\n".join(["t;x", *lines])))
        with pytest.raises(BadRecord, match=re.escape(words)):
            rename(table, {}, ["x"], [])


def test_columns_of_words_are_left_out_and_empty_cells_are_no_numbers(tmp_path):
    lines = ["time;state;x", "0,0;run;1,5", "0,1;run;", "0,2;stop;2,5"]
    table = read_table(write(tmp_path, "\n".join(lines)))
    assert list(table.columns) == ["time", "x"]
    np.testing.assert_array_equal(table.columns["x"], [1.5, np.nan, 2.5])


@pytest.mark.ci
def test_commas_between_numbers_and_in_them_are_told_apart_from_a_broken_row(tmp_path):
    lines = ["time,x", *(f"0,{k},1,{k}" for k in range(10))]
    with pytest.raises(BadRecord, match="commas used both between numbers and as decimal sep"):
        read_table(write(tmp_path, "\n".join(lines)))


def test_a_slip_in_a_column_is_named_where_the_column_is_asked_for(tmp_path):
    rows = [f"0.0{k};{k}" for k in range(10)]
    path = write(tmp_path, "\n".join(["t;x", *rows]).replace("0.02;2", "0.02_5;2"))
    table = read_table(path)
    np.testing.assert_array_equal(rename(table, {}, ["x"], []).columns["x"], np.arange(10.0))
    for mapping in ({"t": "time"}, {"1": "time"}):
        with pytest.raises(BadRecord, match=r"row 4, column 't': '0.02_5' is not a number$"):
            rename(table, mapping, ["time", "x"], [])


@pytest.mark.parametrize(("row", "separator"), [("{:.3f};{:,.3f}", ";"), ('{:.3f},"{:,.3f}"', ",")])
def test_commas_between_thousands_stand_beside_decimal_points(tmp_path, row, separator):
    values = [0.25, 999.5, 1000.125, -1234567.5, 12.0]
    rows = [row.format(k / 1000, v) for k, v in enumerate(values)]
    path = write(tmp_path, "\n".join([f"time{separator}x", *rows, ""]))
    np.testing.assert_array_equal(read_table(path).columns["x"], values)


LINES = [f"{k / 1000:.3f},{k},{2 * k}" for k in range(10)]


@pytest.mark.ci
@pytest.mark.parametrize(
    ("lines", "left_out", "first"),
    [
        ([*LINES, "EOF"], 1, 12),
        ([*LINES, "", "Min,0,0", "Max,9,18", "end of export"], 3, 13),
        ([*LINES[:4], "overrun", *LINES[4:]], 1, 6),
    ],
)
def test_lines_of_words_within_and_behind_the_table_are_left_out_and_told(
    tmp_path, lines, left_out, first
):
    table = read_table(write(tmp_path, "\n".join(["time,x,u", *lines, ""])))
    np.testing.assert_array_equal(table.columns["x"], np.arange(10.0))
    (note,) = table.notes
    assert note.startswith(f"{left_out} invalid line")
    assert note.endswith(f"the first is line {first}")


@pytest.mark.ci
def test_a_last_line_that_breaks_off_is_left_out_and_one_that_is_short_is_refused(tmp_path):
    text = "\n".join(["time,x,u", *LINES, "0.010,1"])
    table = read_table(write(tmp_path, text))
    assert len(table.columns["time"]) == 10
    assert table.notes == ("1 invalid line of the table left out; the first is line 12",)
    for short in (text + "\n", text.replace("0.004,4,8", "0.004,4") + "\n"):
        with pytest.raises(BadRecord, match="2 cells, expected 3"):
            read_table(write(tmp_path, short))


def test_signals_with_times_of_their_own_are_tables_of_their_own(tmp_path):
    rows = ["0.0\t1.0\t0.0\t5.0", "0.1\t2.0\t0.2\t6.0", "0.2\t3.0\t0.4\t7.0", "0.3\t4.0\t\t"]
    path = write(tmp_path, "\n".join(["t\tx\tt\tu", *rows, ""]))
    x, u = read_tables(path)
    assert (x.group, u.group) == ("x", "u")
    np.testing.assert_array_equal(x.columns["x"], [1, 2, 3, 4])
    np.testing.assert_array_equal(u.columns["t"], [0, 0.2, 0.4])
    assert u.numbers == {"3": "t", "4": "u"}
    same = [row.replace("0.2\t6", "0.1\t6").replace("0.4\t7", "0.2\t7") for row in rows]
    path = write(tmp_path, "\n".join(["t\tx\tt\tu", *same[:3], ""]))
    assert list(read_table(path).columns) == ["t", "x", "u"]


def of_two(tmp_path, names):
    """Two tables of a file, each with a time of its own."""
    rows = [f"{k}.0\t{k + 1}.0\t{2 * k}.0\t{k + 5}.0" for k in range(4)]
    return read_tables(write(tmp_path, "\n".join([names, *rows, ""])))


def test_tables_of_one_name_are_numbered_and_which_one_is_meant_is_asked(tmp_path):
    tables = of_two(tmp_path, "t\tx\tt\tx")
    assert [t.group for t in tables] == ["x (1)", "x (2)"]
    asked = [{"t": "time"}, ["time", "x"], [("time",), ("x",)]]
    with pytest.raises(BadRecord, match=r"2 tables with these .*: x \(1\), x \(2\); choose one"):
        choose(tables, *asked)
    with pytest.raises(BadRecord, match=r"none .* has the columns t, i; there are x \(1\)"):
        choose(tables, {"t": "time"}, ["time", "i"], [("time",), ("i",)])
    asked[0] = {"x (2)/t": "time"}
    np.testing.assert_array_equal(choose(tables, *asked).columns["x"], [5, 6, 7, 8])


def test_a_force_that_jumps_as_a_counter_does_is_no_counter():
    jumps = np.r_[0.0, 30_000.0, 60_000.0, 24_464.0, 54_464.0]
    table = Table(Path("a.csv"), {"force": jumps, "x": jumps}, {"x": "mm", "force": "mN"})
    signals, measured, notes = in_si(table, {}, {"force": ["force"], "x": ["length"]}, None)
    np.testing.assert_allclose(signals["force"], 1e-3 * jumps)
    np.testing.assert_allclose(signals["x"], [0.0, 30.0, 60.0, 90.0, 120.0])
    assert (measured, len(notes)) == ({"force": "force", "x": "length"}, 1)


LVM = """LabVIEW Measurement
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tYes
X_Columns\t{columns}
***End_of_Header***

Channels\t2
Samples\t3\t3
Y_Unit_Label\tmm\tV
X_Dimension\tTime\tTime
X0\t0.5\t0.5
Delta_X\t0.25\t0.25
***End_of_Header***
X_Value\tPosition\tVoltage\tComment
{first}\t1.5\t2.5
{second}\t2.5\t3.5
{third}\t3.5\t4.5
"""


def test_a_labview_file_without_a_column_of_time_has_its_steps(tmp_path):
    path = write(tmp_path, LVM.format(columns="No", first="", second="", third=""))
    table = read_table(path)
    np.testing.assert_array_equal(table.columns["X_Value"], [0.5, 0.75, 1.0])
    np.testing.assert_array_equal(table.columns["Voltage"], [2.5, 3.5, 4.5])
    assert table.units == {"Position": "mm", "Voltage": "V"}


def stamped(tmp_path, stamps):
    rows = map(";".join, zip(stamps, ["1.5", "2.5", "4.0", "8.0"], strict=True))
    path = write(tmp_path, "\n".join(["time;x", *rows, ""]))
    return rename(read_table(path), {}, ["time", "x"], [])


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
    table = stamped(tmp_path, [*stamps, ""])
    np.testing.assert_allclose(table.columns["time"], [0, 0.25, 0.5, np.nan], atol=1e-9)
    assert table.units == {"time": "s"}
    assert table.notes == (f"time is in seconds from {stamps[0]}",)


@pytest.mark.ci
def test_stamps_with_decimal_commas_and_columns_without_a_name(tmp_path):
    stamps = ["01.03.2024 12:00:00,000", "01.03.2024 12:00:00,001", "", "01.03.2024 12:00:00,003"]
    rows = [f"{stamp};{k},5" for k, stamp in enumerate(stamps)]
    table = read_table(write(tmp_path, "\n".join([";Weg (mm)", *rows, ""])))
    np.testing.assert_allclose(table.columns["1"], [0, 1e-3, np.nan, 3e-3], atol=1e-9)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (["3/4/2024 23:59"] * 2 + ["4/4/2024 00:00"] * 2, "'3/4/2024 23:59' may be from two days;"),
        (["12:00:00", "noon", "12:00:02", "12:00:03"], "row 3, column 'time': 'noon' is not a"),
    ],
)
def test_stamps_that_are_not_clear_are_refused(tmp_path, stamps, words):
    with pytest.raises(BadRecord, match=words):
        stamped(tmp_path, stamps)


TIME = np.arange(0.0, 4.0, 1e-3)


def x_at(time):
    return 0.1 * np.sin(3 * time)


def u_at(time):
    return 3 * np.sin(5 * time)


def test_asynchronous_stamps_are_put_to_the_slower_ones_where_both_are_known(tmp_path):
    """A workbook with the position in one sheet and the voltage in another."""
    import openpyxl

    of_u = 0.3 + 2.5e-3 * np.arange(1000)
    book = openpyxl.Workbook()
    for name, head, *columns in (
        ("axis", ("t [s]", "x"), TIME, x_at(TIME)),
        ("drive", ("t [ms]", "u"), 1e3 * of_u, u_at(of_u)),
        ("heat", ("t [ms]", "temperature"), 1e3 * of_u[::2], of_u[::2]),
    ):
        sheet = book.create_sheet(name)
        for row in (head, *np.column_stack(columns).tolist()):
            sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    known = {"t": "time", "temperature": "temperature"}
    (record,) = read_drive_records([tmp_path / "a.xlsx"], known)
    np.testing.assert_allclose(record.time, of_u, atol=1e-9)
    np.testing.assert_allclose(record.x, x_at(of_u), atol=1e-6)
    np.testing.assert_allclose(record.u, u_at(of_u), atol=1e-12)
    at_heat = np.where(np.arange(1000) % 2, np.nan, of_u)  # no samples are invented between
    np.testing.assert_allclose(record.signals["temperature"], at_heat, atol=1e-12)
    (note,) = record.notes
    assert note.startswith(
        "x of axis, recorded every 1 ms, is interpolated linearly at the time stamps of drive"
    )
    assert note.endswith("every 2.5, 1 in 2.5 of its samples")
    book["drive"]["A1"] = "t [tick]"
    book.save(tmp_path / "b.xlsx")
    with pytest.raises(BadRecord, match="its times are in"):
        read_drive_records([tmp_path / "b.xlsx"], {"t": "time"})


def test_a_time_that_is_given_by_number_is_that_of_each_signal(tmp_path):
    rows = (f"{t:.3f};{x_at(t):.9f};{t + 0.2505:.4f};{u_at(t + 0.2505):.9f}" for t in TIME.tolist())
    (tmp_path / "a.csv").write_text("\n".join(["t;x;t;u", *rows, ""]))
    (record,) = read_drive_records([tmp_path / "a.csv"], {"1": "time"}, {"time": "s"})
    np.testing.assert_allclose(record.u, u_at(record.time), atol=2e-5)
    np.testing.assert_allclose(record.x, x_at(record.time), atol=1e-6)
