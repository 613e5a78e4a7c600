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
    "such as "
    "t = ts.Time; x = ts.Data; save('a.mat', 't', 'x')"
)
_PACKED = 15  # type of a compressed element
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
        if kind == _PACKED:
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
    """A value of a version 7.3 file in the form of `loadmat` for other versions.

    It takes its cells, and those of a structure's overhead, from `room`: one value may be in many.
    """
    import h5py

    if not is_within(item, file):
        return np.array([])
    if isinstance(item, h5py.Group):
        fields = {n: _plain(path, file, item[n], room) for n in item}
        cells = [n for n in item if isinstance(item[n], h5py.Dataset) and _is_part(item[n])]
        if not cells or len(cells) < len(fields):
            return fields
        return [dict(zip(cells, row, strict=True)) for row in zip(*fields.values(), strict=False)]
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


def _is_part(item: Any) -> bool:
    """Whether a field of a structure array has one reference per element."""
    import h5py

    return bool(item.dtype == h5py.ref_dtype) and "MATLAB_class" not in item.attrs


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
        recorded = _simulink(path, name, value) or _series(path, name, value)
        recorded = recorded or _dspace(path, name, value)
        if recorded:
            groups.extend(recorded)
            return
        for key, inner in value.items():
            yield from _columns(f"{name}.{key}" if name else key, inner, path, groups)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for k, inner in enumerate(np.asarray(value, dtype=object).ravel(), 1):
            if isinstance(inner, Mapping):
                yield from _columns(f"{name}({k})", inner, path, groups)
    elif isinstance(value, np.ndarray | np.generic | float | int):
        yield from columns_of(name, np.asarray(value))


def _several(value: Any) -> list[Mapping[str, Any]]:
    """A structure, or an array of structures, as a list."""
    items = [value] if isinstance(value, Mapping) else value
    if not isinstance(items, list | np.ndarray):
        return []
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


def _series(path: Path, name: str, value: Mapping[str, Any]) -> list[Table]:
    """A timeseries that was converted to a structure."""
    own = {key.lower(): inner for key, inner in value.items()}
    time, values = _numbers(own.get("time")), _numbers(own.get("data"))
    if not time.size or values.shape[:1] != time.shape[:1] or len(own) > 20:
        return []
    label = _text(own.get("name")) or name.rpartition(".")[2]
    about = own.get("datainfo"), own.get("timeinfo")
    units = [_text(a.get("Units")) if isinstance(a, Mapping) else "" for a in about]
    of_time = {"seconds": "s", "milliseconds": "ms"}.get(units[1], units[1])
    columns = [*columns_of("time", time, of_time), *columns_of(label, values, units[0])]
    return [table_of(path, columns, name)]


def _dspace(path: Path, name: str, value: Mapping[str, Any]) -> list[Table]:
    """A recording of dSPACE ControlDesk: axes X, and signals Y with the number of their axis."""
    axes, signals = _several(value.get("X")), _several(value.get("Y"))
    axes = [a for a in axes if "Data" in a]
    signals = [s for s in signals if "Data" in s and "Name" in s]
    if not axes or not signals:
        return []
    tables = []
    sizes = [_numbers(axis["Data"]).size for axis in axes]
    for k, axis in enumerate(axes):
        columns = list(columns_of("time", _numbers(axis["Data"]), _text(axis.get("Unit"))))
        for signal in signals:
            values, said = _numbers(signal["Data"]), int(signal.get("XIndex", 1) or 1) - 1
            fitting = [j for j, size in enumerate(sizes) if size == values.size]
            if (said if said in fitting else next(iter(fitting), None)) == k:
                columns += columns_of(_text(signal["Name"]), values, _text(signal.get("Unit")))
        tables.append(table_of(path, columns, name if len(axes) == 1 else f"{name}.X({k + 1})"))
    return tables


def _modelica(path: Path, found: Mapping[str, Array]) -> list[Table]:
    """A result of Dymola or OpenModelica: columns of `data_k` by signed number."""
    lines = _lines(found["Aclass"])
    if len(lines) < 4 or lines[0] != "Atrajectory":
        raise BadRecord(
            f"{path}: is a MAT-file of Modelica, but not a result; save the result as CSV"
        )
    turned = lines[3] == "binTrans"
    texts = {n: _lines(v.T if turned else v) for n, v in found.items() if v.dtype.kind == "U"}
    data = {n: v if turned else v.T for n, v in found.items() if n.startswith("data_")}
    info = found["dataInfo"].T if turned else found["dataInfo"]
    said = texts.get("description") or [""] * len(texts["name"])
    tables = []
    for block in sorted(n for n in data if n != "data_1"):  # data_1 has constants
        columns = list(columns_of("time", data[block][0], "s"))
        for name, about, (of, column, *_) in zip(texts["name"], said, info.tolist(), strict=True):
            if block == f"data_{int(of)}" and abs(column) > 1 and name != "time":
                values = np.sign(column) * data[block][abs(int(column)) - 1]
                unit = _UNIT.search(about)
                columns += columns_of(name, values, unit[1].strip() if unit else "")
        tables.append(table_of(path, columns, block if len(data) > 2 else ""))
    return tables


def _lines(chars: Array) -> Sequence[str]:
    return ["".join(map(str, row)).replace("\0", " ").strip() for row in np.atleast_2d(chars)]
