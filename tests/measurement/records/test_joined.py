"""Columns that stand in several tables of a file, each with a time of its own."""

from __future__ import annotations

import numpy as np

from ballscrew.measurement.records.reading import read_drive_records

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
    ):
        sheet = book.create_sheet(name)
        for row in (head, *np.column_stack(columns).tolist()):
            sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    (record,) = read_drive_records([tmp_path / "a.xlsx"], {"t": "time"})
    np.testing.assert_allclose(record.time, of_u, atol=1e-9)
    np.testing.assert_allclose(record.x, x_at(of_u), atol=1e-6)
    np.testing.assert_allclose(record.u, u_at(of_u), atol=1e-12)
    (note,) = record.notes
    assert note.startswith(
        "x of axis, recorded every 1 ms, is interpolated linearly at the time stamps of drive"
    )
    assert note.endswith("every 2.5, 1 in 2.5 of its samples")


def test_a_time_that_is_given_by_number_is_that_of_each_signal(tmp_path):
    rows = (f"{t:.3f};{x_at(t):.9f};{t + 0.2505:.4f};{u_at(t + 0.2505):.9f}" for t in TIME.tolist())
    (tmp_path / "a.csv").write_text("\n".join(["t;x;t;u", *rows, ""]))
    (record,) = read_drive_records([tmp_path / "a.csv"], {"1": "time"}, {"time": "s"})
    np.testing.assert_allclose(record.u, u_at(record.time), atol=2e-5)
    np.testing.assert_allclose(record.x, x_at(record.time), atol=1e-6)
