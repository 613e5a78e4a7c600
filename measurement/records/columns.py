"""Columns of measured data and their table, of which every file format is made; largest sizes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.errors import BadRecord

Array = npt.NDArray[Any]
Notes = Sequence[str]
Lines = npt.NDArray[np.int64] | None

MOST = {
    "rows": 5_000_000,
    "cells": 50_000_000,
    "bytes of text": 2**28,
    "bytes when unpacked": 2**28,
    "characters in a line": 2**20,
    "characters in the name of a column": 500,
}
"""Largest sizes of a file; it is refused before anything larger is made."""
_OVERFLOW = 9.9e36  # a meter writes 9.9e37 for an overflow, netCDF 9.97e36 for an empty cell


def check_size(path: Path, what: str, size: int) -> None:
    """Raise BadRecord if there is more of `what`, a key of `MOST`, than is read."""
    if size > MOST[what]:
        expected = f"expected at most {MOST[what]}; save a part of it"
        raise BadRecord(f"{path}: has {size} {what}, {expected}")


class Column(NamedTuple):
    """A column under its name in the file, with its values or with what is wrong with them."""

    name: str
    values: Vector | None = None
    unit: str = ""
    start: str = ""  # the date of 0 s, if it was written as dates
    fault: str = ""  # the end of a message that begins with the file's name
    number: str = ""  # of a column in a text


@dataclass(frozen=True)
class Table:
    """Columns of a file under their names in the file, by name."""

    path: Path
    columns: dict[str, Vector]  # lengths may differ; numbered from 1 where there is no name
    units: dict[str, str] = field(default_factory=dict)  # as written in the file
    lines: npt.NDArray[np.int64] | None = None  # numbers of the rows in a text, from 1
    group: str = ""  # this table's name in the file, if it has several
    numbers: dict[str, str] = field(default_factory=dict)  # names by the number in a text, from 1
    notes: tuple[str, ...] = ()
    start: str = ""  # the date of 0 s, if time was written as dates
    renamed: dict[str, str] = field(default_factory=dict)  # what our names are called in the file
    faults: dict[str, str] = field(default_factory=dict)  # of columns that are no numbers


def table_of(
    path: Path, columns: Iterable[Column], group: str = "", lines: Lines = None, notes: Notes = ()
) -> Table:
    """The table of some columns; those of one name are numbered, as ``x #1`` and ``x #2``.

    A word in brackets after a name, as in ``time [ms]``, is the column's unit, known or not. The
    name is the text before it, if no other column has that name.
    """
    every = list(columns)
    names = [c.name for c in every]
    while len(set(names)) < len(names):
        often, seen = Counter(names), Counter[str]()
        for k, name in enumerate(names):
            seen[name] += 1
            names[k] = name if often[name] == 1 else f"{name} #{seen[name]}"
    check_size(path, "characters in the name of a column", max(map(len, names), default=0))
    split = [name_and_unit(n) for n in names]
    times = Counter(bare for bare, _ in split)
    names = [b if times[b] == 1 else n for (b, _), n in zip(split, names, strict=True)]
    units = [unit or c.unit for (_, unit), c in zip(split, every, strict=True)]
    named = dict(zip(names, every, strict=True))
    values = {n: c.values for n, c in named.items() if c.values is not None}
    starts = {n: named[n].start for n in values if named[n].start}
    return Table(
        path,
        {n: np.where(np.abs(v) < _OVERFLOW, v, np.nan) for n, v in values.items()},
        {n: unit for n, unit in zip(names, units, strict=True) if unit and n in values},
        lines,
        group,
        {c.number: n for n, c in named.items() if c.number},
        (*notes, *(f"{n} is in seconds from {start}" for n, start in starts.items())),
        next(iter(starts.values()), ""),
        faults={n: c.fault for n, c in named.items() if c.values is None},
    )


def name_and_unit(name: str) -> tuple[str, str]:
    """Both parts of ``time [ms]`` or ``x (mm)``; the unit of another name is empty."""
    whole = name.strip()
    at = max(whole.rfind("["), whole.rfind("("))
    bare, unit = whole[: max(at, 0)].rstrip(), whole[at + 1 : -1].strip()
    return (bare, unit) if bare and unit and whole[-1] in "])" else (name, "")


def columns_of(name: str, array: Array, unit: str = "") -> Iterator[Column]:
    """The columns of an array of numbers; those of a matrix are ``name.1`` and so on.

    Samples are along the longer side. Fields are named ``name.field``; dates and durations become
    seconds, dates from the first one.
    """
    start = ""
    if array.dtype.names:
        for field_name in array.dtype.names:
            yield from columns_of(f"{name}.{field_name}", array[field_name])
        return
    if array.dtype.kind in "mM" and array.size:
        if array.dtype.kind == "M":
            first = np.fmin.reduce(array.ravel())
            array, start = array - first, str(first)
        array = np.where(np.isnat(array), np.nan, array / np.timedelta64(1, "ns") * 1e-9)
        unit = "s"
    array = np.squeeze(array)
    if array.dtype.kind not in "fiub" or not array.size or array.ndim > 2:
        shape = " x ".join(map(str, array.shape)) or "one"
        yield Column(name, fault=f": {name!r} has {shape} values of type {array.dtype}, no numbers")
    elif array.ndim < 2:
        yield Column(name, array.astype(float).ravel(), unit, start)
    elif array.size <= MOST["cells"]:  # larger ones are pictures
        rows = array if array.shape[0] < array.shape[1] else array.T
        for k, row in enumerate(rows, 1):
            yield Column(f"{name}.{k}", row.astype(float), unit, start)
