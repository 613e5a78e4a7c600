"""Tables in binary files of measurements, read by maintained libraries.

Each function takes the path, for messages, and the bytes of the file. It raises ImportError if its
library is not installed.
"""

from __future__ import annotations

import gc
import io
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ...solver.errors import BadRecord
from .columns import Column, Table, check_size, columns_of, table_of
from .csv_table import read_lines

_TERM = re.compile(
    r"[\s+\-*/^(),]|\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
    r"|\b(?:[Xx]1*|sin|cos|tan|asin|acos|atan|exp|log|log10|sqrt|abs)\b"
)


def read_npz(path: Path, data: bytes) -> list[Table]:
    columns: list[Column] = []
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        for name in archive.files:
            try:
                columns += columns_of(name, archive[name])
            except ValueError:  # objects; to read them would run code
                columns.append(Column(name, fault=f": {name!r} has objects, which are not read"))
    return [table_of(path, columns)]


def read_npy(path: Path, data: bytes) -> list[Table]:
    columns = columns_of("", np.load(io.BytesIO(data), allow_pickle=False))
    return [table_of(path, [c._replace(name=c.name.partition(".")[2] or "1") for c in columns])]


def read_hdf5(path: Path, data: bytes) -> list[Table]:
    """Each group with numbers is a table."""
    import h5py

    groups: dict[str, dict[str, Any]] = {}

    def visit(name: str, item: Any) -> None:  # no links
        if isinstance(item, h5py.Dataset) and is_within(item, file):
            group, _, own = name.rpartition("/")
            groups.setdefault(group, {})[own] = item

    with h5py.File(io.BytesIO(data), "r") as file:
        file.visititems(visit)
        sets = [s for group in groups.values() for s in group.values() if s.size]
        check_size(path, "cells", sum(s.size * max(1, s.dtype.itemsize // 8) for s in sets))
        tables = [
            table_of(path, [c for n, s in sets.items() for c in _unpacked(n, s)], group)
            for group, sets in groups.items()
        ]
    return [t for t in tables if t.columns]


def _unpacked(name: str, item: Any) -> Iterator[Column]:
    """The columns of a data set, by netCDF's attributes of packed and of empty values."""
    if not item.shape or item.dtype.kind not in "fiubV":
        yield Column(name, fault=f": {name!r} has values of type {item.dtype}, not numbers")
        return
    names = "units", "unit", "scale_factor", "add_offset", "_FillValue", "missing_value"
    attributes = {n: np.ravel(item.attrs[n])[0] for n in names if np.size(item.attrs.get(n, ()))}
    unit = attributes.get("units", attributes.get("unit", ""))
    values = item[()]
    empty = [attributes[n] for n in names[4:] if n in attributes]
    scale, offset = attributes.get("scale_factor", 1), attributes.get("add_offset", 0)
    if empty or (scale, offset) != (1, 0):
        values = np.where(np.isin(values, empty), np.nan, values) * float(scale) + float(offset)
    yield from columns_of(name, values, unit.decode() if isinstance(unit, bytes) else str(unit))


def is_within(item: Any, file: Any) -> bool:
    """Whether an item's numbers are in the HDF5 file itself, and not in other files of the user."""
    import h5py

    elsewhere = isinstance(item, h5py.Dataset) and (item.external or item.is_virtual)
    return bool(item.file.filename == file.filename and not elsewhere)


def read_tdms(path: Path, data: bytes) -> list[Table]:
    """Each group is a table; one per rate if its channels have different rates."""
    from nptdms import TdmsFile

    tables = []
    channels = [c for g in TdmsFile.read_metadata(io.BytesIO(data)).groups() for c in g.channels()]
    check_size(path, "cells", sum(map(len, channels)))
    starts = [c.properties.get("wf_start_time") for c in channels]
    first = min((s for s in starts if s is not None), default=None)
    for group in TdmsFile.read(io.BytesIO(data)).groups():
        rates: dict[tuple[Any, ...], list[Column]] = {}
        for channel in group.channels():
            properties = channel.properties
            names = "wf_increment", "wf_start_offset", "wf_start_time"
            step, offset, start = map(properties.get, names)
            columns = rates.setdefault((step, offset, start, len(channel)) if step else (), [])
            if step and not columns:
                late = 0 if start is None else (start - first) / np.timedelta64(1, "ns") * 1e-9
                time = late + (offset or 0.0) + step * np.arange(len(channel))
                columns.append(Column("time", time, "s"))
            unit = str(properties.get("unit_string", ""))
            columns += columns_of(channel.name, np.asarray(channel[:]), unit)
        for rate, columns in rates.items():
            several = f" ({rate[0]:g} s)" if rate and len(rates) > 1 else ""
            tables.append(table_of(path, columns, group.name + several))
    return [t for t in tables if t.columns]


def read_mdf(path: Path, data: bytes) -> list[Table]:
    """Each group of channels is a table, with its master channel as ``time``."""
    from asammdf import MDF
    from asammdf.blocks import v2_v3_blocks, v4_blocks

    # the library gives formulas of the file to this function, which would run any code in them
    v2_v3_blocks.lambdify = v4_blocks.lambdify = _refuse_formula
    try:
        with MDF(io.BytesIO(data)) as file:
            for group in file.groups:
                rows, channels = group.channel_group.cycles_nr, group.channels
                check_size(path, "cells", rows * len(channels))
                for channel in channels:
                    _check_formulas(channel.conversion)
            tables = [_of_mdf(path, file, k) for k in range(len(file.groups))]
    except Exception as error:
        # an incomplete object of the library fails again when it is deleted, and Python prints that
        hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
        traceback.clear_frames(error.__traceback__)
        gc.collect()
        sys.unraisablehook = hook
        raise
    return [t for t in tables if t.columns]


def _check_formulas(conversion: Any) -> None:
    """Raise an error for a formula that is more than a function of the raw value."""
    formula = getattr(conversion, "formula", "")
    formula = formula.decode("latin-1") if isinstance(formula, bytes) else str(formula)
    if _TERM.sub("", formula):
        raise ValueError(f"the formula {formula[:80]!r} of a channel is no function of its values")
    for block in (getattr(conversion, "referenced_blocks", None) or {}).values():
        if hasattr(block, "formula"):
            _check_formulas(block)


def _refuse_formula(*_: Any, **__: Any) -> NoReturn:
    raise ValueError("the formula of a channel cannot be computed")


def _of_mdf(path: Path, file: Any, k: int) -> Table:
    group, master = file.groups[k], file.masters_db.get(k)
    columns: list[Column] = []
    for j, channel in enumerate(group.channels):
        if j == master:
            continue
        signal = file.get(group=k, index=j, ignore_invalidation_bits=True)
        values, bad = np.asarray(signal.samples), signal.invalidation_bits
        if bad is not None and values.dtype.kind in "fiub":
            values = np.where(np.asarray(bad), np.nan, values)
        # a master may be an angle or a distance
        if not columns and getattr(group.channels[master or 0], "sync_type", 1) <= 1:
            columns.append(Column("time", np.asarray(signal.timestamps, dtype=float), "s"))
        columns += columns_of(channel.name, values, signal.unit or "")
    name = getattr(group.channel_group, "acq_name", "") or f"group {k + 1}"
    return table_of(path, columns, name)


def read_xlsx(path: Path, data: bytes) -> list[Table]:
    """Each sheet with a table; the table is detected as in a text."""
    import openpyxl

    book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
    tables: list[Table] = []
    faults = []
    for sheet in book.worksheets:
        try:
            for table in read_lines(path, _rows(path, book, sheet)):
                group = f"{sheet.title}/{table.group}" if table.group else sheet.title
                tables.append(replace(table, group=group))
        except BadRecord as error:
            faults.append(error)
    book.close()
    if not tables and faults:
        raise faults[0]
    return tables


def _rows(path: Path, book: Any, sheet: Any) -> Iterator[tuple[int, str]]:
    """The rows of a sheet as lines of a text."""
    # the library would round dates to milliseconds, and make all cells up to the last one
    from openpyxl.worksheet._reader import WorkSheetParser

    size = 0
    with sheet._get_source() as source:
        parser = WorkSheetParser(source, sheet._shared_strings, data_only=True)
        for row, cells in parser.parse():
            texts = [""] * max((c["column"] for c in cells), default=0)
            for c in cells:
                dated = c["style_id"] in book._date_formats
                texts[c["column"] - 1] = _cell(c["value"], book.epoch if dated else None)
            line = "\t".join(texts)
            size += len(line)
            check_size(path, "bytes of text", size)
            yield row, line


def _cell(value: object, epoch: datetime | None) -> str:
    if epoch and isinstance(value, int | float) and value >= 0:
        with suppress(OverflowError):  # after the year 9999 it is no date
            date = epoch + timedelta(days=value)
            return date.isoformat(" ") if value >= 1 else date.time().isoformat()
    return "" if value is None else " ".join(str(value).split())


def read_arrow(path: Path, data: bytes) -> list[Table]:
    """Parquet, or else Arrow: numbers, dates, durations and times of day."""
    from pyarrow import BufferReader, duration, float64, int64, time64, timestamp, types
    from pyarrow.dataset import IpcFileFormat
    from pyarrow.parquet import ParquetFile

    if data.startswith(b"PAR1"):  # as a data set, two columns of one name are not read
        file = ParquetFile(BufferReader(data))
        schema, rows, read = file.schema_arrow, file.metadata.num_rows, file.read
    else:
        part = IpcFileFormat().make_fragment(BufferReader(data))
        schema, rows, read = part.physical_schema, part.count_rows(), part.to_table
    kinds = types.is_integer, types.is_floating, types.is_boolean, types.is_decimal
    numbers = [f.name for f in schema if any(is_kind(f.type) for is_kind in kinds)]
    names = numbers + [f.name for f in schema if types.is_temporal(f.type)]
    words = (f for f in schema if f.name not in names)
    columns = [Column(f.name, fault=f": {f.name!r} is {f.type}, not numbers") for f in words]
    check_size(path, "rows", rows)
    check_size(path, "cells", rows * len(names))
    table = read(columns=names)
    for name, column in zip(table.column_names, table.columns, strict=True):
        if types.is_time(column.type):
            column = column.cast(time64("ns")).cast(int64()).cast(duration("ns"))
        elif name in numbers:
            column = column.cast(float64(), safe=False)  # nanoseconds since 1970 have 61 bits
        elif not types.is_duration(column.type):
            column = column.cast(timestamp("ns"))
        columns += columns_of(name, np.asarray(column.to_numpy()))
    return [table_of(path, columns)]
