"""Tables in MAT files of MATLAB, Simulink, dSPACE, Dymola and OpenModelica."""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.errors import BadRecord
from .binary_tables import is_within
from .columns import MOST, Array, Column, Table, check_size, columns_of, table_of

_OBJECTS = (
    "contains objects (timeseries, table, Dataset) that only MATLAB can read; save their numbers, "
    "such as t = ts.Time; x = ts.Data; save('a.mat', 't', 'x')"
)
_OVERHEAD = 1000  # cells whose time one value of a structure takes
_UNIT = re.compile(r"\[([^\[\]|:#]+)(?:\|[^\[\]]*)?\]\s*$")  # at the end of a Modelica description


def read_mat(path: Path, data: bytes) -> list[Table]:
    """Read files of versions 4 to 7."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    _check_unpacked(path, data)
    found = loadmat(io.BytesIO(data), simplify_cells=True)
    if {"Aclass", "name", "dataInfo", "data_2"} <= found.keys():
        chars = loadmat(io.BytesIO(data), chars_as_strings=False)
        return _modelica(path, {n: v for n, v in chars.items() if not n.startswith("__")})
    opaque = any(isinstance(v, MatlabOpaque) for v in found.values()) or "None" in found
    values = {n: v for n, v in found.items() if not n.startswith("__") and n != "None"}
    return _tables(path, values, opaque)


def _check_unpacked(path: Path, data: bytes) -> None:
    """Refuse a file of version 5 whose packed values are too large together."""
    order = ">" if data[126:128] == b"MI" else "<"
    at, left = 128, MOST["bytes when unpacked"] + 1
    while at + 8 <= len(data) and data[126:128] in (b"MI", b"IM"):
        kind, size = struct.unpack_from(f"{order}2I", data, at)
        if kind == 15:  # a compressed element
            left -= len(zlib.decompressobj().decompress(data[at + 8 : at + 8 + size], left))
            check_size(path, "bytes when unpacked", MOST["bytes when unpacked"] + 1 - left)
        at += 8 + size


def read_mat73(path: Path, data: bytes) -> list[Table]:
    import h5py

    with h5py.File(io.BytesIO(data), "r") as file:
        names = [n for n in file if not n.startswith("#")]
        objects = {n for n in names if "MATLAB_object_decode" in file[n].attrs}
        room = [MOST["cells"]]
        values = {n: _plain(path, file, file[n], room) for n in names if n not in objects}
    return _tables(path, values, bool(objects))


def _plain(path: Path, file: Any, item: Any, room: list[int]) -> Any:
    """A value of a version 7.3 file as of `loadmat`; `room` counts cells, shared ones each time."""
    import h5py

    if not is_within(item, file):
        return np.array([])
    if isinstance(item, h5py.Group):
        fields = {n: _plain(path, file, item[n], room) for n in item}
        sets = [s for s in map(item.get, fields) if isinstance(s, h5py.Dataset)]
        parts = [s for s in sets if s.dtype == h5py.ref_dtype and "MATLAB_class" not in s.attrs]
        if not parts or len(parts) < len(fields):
            return fields  # an array of structures has references, one for each element
        return [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=False)]
    if item.attrs.get("MATLAB_empty", 0):
        return np.array([])
    room[0] -= item.size + _OVERHEAD
    check_size(path, "cells", MOST["cells"] - room[0])
    values = item[()]
    if values.dtype == h5py.ref_dtype:
        return [_plain(path, file, file[ref], room) for ref in values.T.ravel()]
    if item.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, values.T.ravel()))
    return np.squeeze(values.T)


def _tables(path: Path, values: Mapping[str, Any], opaque: bool) -> list[Table]:
    groups: list[Table] = []
    plain = table_of(path, _columns("", values, path, groups))
    tables = [*([plain] if plain.columns else []), *groups]
    if opaque and not tables:
        raise BadRecord(f"{path}: {_OBJECTS}")
    return tables


def _columns(name: str, value: Any, path: Path, groups: list[Table]) -> Iterator[Column]:
    """The columns of a value, except those of a recording, which is added to `groups`."""
    if isinstance(value, Mapping):
        recorded = _simulink(path, name, value) or _dspace(path, name, value)
        groups.extend(recorded)
        for key, inner in value.items() if not recorded else ():
            yield from _columns(f"{name}.{key}" if name else key, inner, path, groups)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for k, inner in enumerate(np.asarray(value, dtype=object).ravel(), 1):
            if isinstance(inner, Mapping):
                yield from _columns(f"{name}({k})", inner, path, groups)
    elif isinstance(value, np.ndarray | np.generic | float | int):
        yield from columns_of(name, np.asarray(value))


def _several(value: Any) -> list[Mapping[str, Any]]:
    """A structure, or an array of structures, as a list."""
    items = value if isinstance(value, list | np.ndarray) else [value]
    return [v for v in items if isinstance(v, Mapping)]


def _numbers(value: Any) -> Array:
    array = np.asarray(value)
    return array if array.dtype.kind in "fiub" else np.array([])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _simulink(path: Path, name: str, value: Mapping[str, Any]) -> list[Table]:
    """A structure with time, as written by Simulink's scopes and To Workspace."""
    signals = _several(value.get("signals"))
    time = _numbers(value.get("time"))
    if not signals or not time.size:
        return []
    columns = list(columns_of("time", time))
    for k, signal in enumerate(signals, 1):
        values = _numbers(signal.get("values"))
        values = np.moveaxis(values, -1, 0) if values.ndim > 2 else values
        columns += columns_of(_text(signal.get("label")) or f"signal {k}", values)
    return [table_of(path, columns, name)]


def _dspace(path: Path, name: str, value: Mapping[str, Any]) -> list[Table]:
    """A recording of dSPACE ControlDesk: axes X, and signals Y with the number of their axis."""
    axes = [a for a in _several(value.get("X")) if "Data" in a]
    signals = [s for s in _several(value.get("Y")) if "Data" in s and "Name" in s]
    times = [_numbers(axis["Data"]) for axis in axes]
    columns = [
        list(columns_of("time", t, _text(a.get("Unit")))) for t, a in zip(times, axes, strict=True)
    ]
    for signal in signals:
        values, said = _numbers(signal["Data"]), int(signal.get("XIndex", 1) or 1) - 1
        fitting = [k for k, time in enumerate(times) if time.size == values.size]
        for k in [said] if said in fitting else fitting[:1]:
            columns[k] += columns_of(_text(signal["Name"]), values, _text(signal.get("Unit")))
    groups = [name] if len(axes) == 1 else [f"{name}.X({k + 1})" for k in range(len(axes))]
    return [table_of(path, c, g) for c, g in zip(columns, groups, strict=True)] if signals else []


def _modelica(path: Path, found: Mapping[str, Array]) -> list[Table]:
    """A result of Dymola or OpenModelica: columns of `data_k` by signed number."""
    lines = _lines(found["Aclass"])
    if len(lines) < 4 or lines[0] != "Atrajectory":
        raise BadRecord(f"{path}: is no result of a Modelica simulation; save the result as CSV")
    rows = {n: v.T if lines[3] == "binTrans" else v for n, v in found.items()}
    data = {n: v.T for n, v in rows.items() if n.startswith("data_")}
    names, info = _lines(rows["name"]), rows["dataInfo"].tolist()
    said = _lines(rows["description"]) if "description" in rows else [""] * len(info)
    tables = []
    for block in sorted(data.keys() - {"data_1"}):  # data_1 has constants
        columns = list(columns_of("time", data[block][0], "s"))
        for name, about, (of, column, *_) in zip(names, said, info, strict=True):
            if block == f"data_{int(of)}" and abs(column) > 1 and name != "time":
                values = np.sign(column) * data[block][abs(int(column)) - 1]
                unit = _UNIT.search(about)
                columns += columns_of(name, values, unit[1].strip() if unit else "")
        tables.append(table_of(path, columns, block if len(data) > 2 else ""))
    return tables


def _lines(chars: Array) -> Sequence[str]:
    return ["".join(map(str, row)).replace("\0", " ").strip() for row in np.atleast_2d(chars)]
