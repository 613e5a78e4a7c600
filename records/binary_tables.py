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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from .bad_record import BadRecord
from .csv_table import Table, read_text

Vector = npt.NDArray[np.float64]
Array = npt.NDArray[Any]

_WIDEST = 1000  # columns of a matrix; wider ones are pictures
_FUNCTIONS = (
    "sin cos tan arcsin arccos arctan arctan2 asin acos atan sinh cosh tanh exp expm1 log log10 "
    "log1p sqrt abs floor ceil where"
)
_FORMULA = re.compile(
    rf"(?:[\s+\-*/^%(),<>=!&|~]|\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
    rf"|\b(?:[Xx]1*|INF|NaN|{_FUNCTIONS.replace(' ', '|')})\b)*"
)


def table_of(
    path: Path, arrays: Mapping[str, Array], units: Mapping[str, str], group: str = ""
) -> Table:
    """A table of the numbers in arrays; dates become seconds from the first one."""
    columns: dict[str, Vector] = {}
    said = dict(units)
    starts = []
    for name, array in arrays.items():
        if array.dtype.kind == "M" and array.size:
            said[name] = "s"
            starts.append(str(array.ravel()[0]))
        columns |= vectors(name, array)
    kept = {n: u for n, u in said.items() if n in columns and u}
    notes = tuple(f"dates are seconds from {start}" for start in starts)
    return Table(path, columns, kept, group=group, notes=notes, start=" ".join(starts))


def vectors(name: str, array: Array) -> dict[str, Vector]:
    """The columns of an array of numbers; those of a matrix are ``name.1`` and so on.

    Samples are along the longer side. Fields are named ``name.field``; other arrays are ignored.
    """
    if array.dtype.names:
        parts = {n: vectors(f"{name}.{n}", array[n]) for n in array.dtype.names}
        return {n: v for part in parts.values() for n, v in part.items()}
    if array.dtype.kind == "M":
        since = array - array.ravel()[:1]
        array = np.where(np.isnat(since), np.nan, since / np.timedelta64(1, "ns") * 1e-9)
    if array.dtype.kind not in "fiub" or not array.size:
        return {}
    array = np.squeeze(array)
    if array.ndim < 2:
        return {name: array.astype(float).ravel()}
    if array.ndim > 2 or min(array.shape) > _WIDEST:
        return {}
    rows = array if array.shape[0] < array.shape[1] else array.T
    return {f"{name}.{k}": row.astype(float) for k, row in enumerate(rows, 1)}


def read_npz(path: Path, data: bytes) -> list[Table]:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        arrays = {}
        for name in archive.files:
            try:
                arrays[name] = archive[name]
            except ValueError:  # objects; to read them would run code
                continue
    return [table_of(path, arrays, {})]


def read_npy(path: Path, data: bytes) -> list[Table]:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    columns = {n.partition(".")[2] or "1": v for n, v in vectors("", array).items()}
    return [Table(path, columns)]


def read_hdf5(path: Path, data: bytes) -> list[Table]:
    """Each group with numbers is a table."""
    import h5py

    def own(group: Any, name: str, kind: type) -> bool:
        return group.get(name, getclass=True) is kind and is_within(group[name], file)

    def inside(group: Any) -> Iterator[Any]:
        yield group
        for name in group:
            if own(group, name, h5py.Group):
                yield from inside(group[name])

    tables = []
    with h5py.File(io.BytesIO(data), "r") as file:
        for group in inside(file):
            sets = {n: group[n] for n in group if own(group, n, h5py.Dataset)}
            told = {n: s.attrs.get("units", s.attrs.get("unit", "")) for n, s in sets.items()}
            units = {n: u.decode() if isinstance(u, bytes) else str(u) for n, u in told.items()}
            arrays = {n: s[()] for n, s in sets.items() if s.shape and s.dtype.kind in "fiubV"}
            tables.append(table_of(path, arrays, units, group.name.strip("/")))
    return [t for t in tables if t.columns]


def is_within(item: Any, file: Any) -> bool:
    """Whether an item's numbers are in the HDF5 file itself, and not in other files of the user."""
    import h5py

    elsewhere = isinstance(item, h5py.Dataset) and (item.external or item.is_virtual)
    return bool(item.file.filename == file.filename and not elsewhere)


def read_tdms(path: Path, data: bytes) -> list[Table]:
    """Each group is a table; one per rate if its channels have different rates."""
    from nptdms import TdmsFile

    tables = []
    file = TdmsFile.read(io.BytesIO(data))
    starts = [c.properties.get("wf_start_time") for g in file.groups() for c in g.channels()]
    first = min((s for s in starts if s is not None), default=None)
    for group in file.groups():
        rates: dict[tuple[Any, ...], list[Any]] = {}
        for channel in group.channels():
            told = channel.properties
            rate = tuple(told.get(f"wf_{n}") for n in ("increment", "start_offset", "start_time"))
            rates.setdefault((*rate, len(channel)) if rate[0] else (), []).append(channel)
        for rate, channels in rates.items():
            arrays = {c.name: np.asarray(c[:]) for c in channels}
            units = {c.name: str(c.properties.get("unit_string", "")) for c in channels}
            if rate:
                step, offset, start, samples = rate
                late = (
                    (start - first) / np.timedelta64(1, "ns") * 1e-9 if start is not None else 0.0
                )
                time = late + (offset or 0.0) + step * np.arange(samples)
                arrays, units = {"time": time, **arrays}, {"time": "s", **units}
            several = f" ({rate[0]:g} s)" if rate and len(rates) > 1 else ""
            tables.append(table_of(path, arrays, units, group.name + several))
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
                for channel in group.channels:
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
    if not _FORMULA.fullmatch(formula):
        raise ValueError(f"the formula {formula[:80]!r} of a channel is no function of its values")
    for block in (getattr(conversion, "referenced_blocks", None) or {}).values():
        if hasattr(block, "formula"):
            _check_formulas(block)


def _refuse_formula(*_: Any, **__: Any) -> NoReturn:
    raise ValueError("the formula of a channel cannot be computed")


def _of_mdf(path: Path, file: Any, k: int) -> Table:
    group, master = file.groups[k], file.masters_db.get(k)
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    for j, channel in enumerate(group.channels):
        if j == master:
            continue
        signal = file.get(group=k, index=j, ignore_invalidation_bits=True)
        values, bad = np.asarray(signal.samples), signal.invalidation_bits
        if bad is not None and values.dtype.kind in "fiub":
            values = np.where(np.asarray(bad), np.nan, values)
        # a master may be an angle or a distance
        if not arrays and getattr(group.channels[master or 0], "sync_type", 1) <= 1:
            arrays["time"], units["time"] = np.asarray(signal.timestamps), "s"
        arrays[channel.name], units[channel.name] = values, signal.unit or ""
    name = getattr(group.channel_group, "acq_name", "") or f"group {k + 1}"
    return table_of(path, arrays, units, name)


def read_xlsx(path: Path, data: bytes) -> list[Table]:
    """Each sheet with a table; the table is detected as in a text."""
    import openpyxl

    book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
    tables: list[Table] = []
    faults = []
    for sheet in book.worksheets:
        rows = ["\t".join(map(_cell, row)) for row in sheet.iter_rows(values_only=True)]
        try:
            found = read_text(path, "\n".join(rows).encode())
        except BadRecord as error:
            faults.append(error)
            continue
        for table in found:
            group = f"{sheet.title}/{table.group}" if table.group else sheet.title
            tables.append(Table(**{**vars(table), "group": group}))
    book.close()
    if not tables and faults:
        raise faults[0]
    return tables


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(value)
    return " ".join(str(value).split())


def read_parquet(path: Path, data: bytes) -> list[Table]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    return [_of_arrow(path, pq.read_table(pa.BufferReader(data)))]


def read_arrow(path: Path, data: bytes) -> list[Table]:
    import pyarrow as pa

    return [_of_arrow(path, pa.ipc.open_file(pa.BufferReader(data)).read_all())]


def _of_arrow(path: Path, table: Any) -> Table:
    import pyarrow as pa

    arrays: dict[str, Array] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        dates = pa.types.is_timestamp(column.type)
        kind = pa.timestamp("ns") if dates else pa.float64()
        try:
            arrays[name] = np.asarray(column.cast(kind).to_numpy())
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            continue  # words are not a signal
    return table_of(path, arrays, {})
