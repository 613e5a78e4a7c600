"""Read tables of numbers: CSV, MAT and Parquet files with columns of any name."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..solver.nearest import nearest
from ..solver.tables import PYARROW
from .bad_record import BadRecord
from .csv_table import Table, read_csv
from .units import NO_UNIT, UNITS, Conversion, quantity_of

Vector = npt.NDArray[np.float64]

_WITH_UNIT = re.compile(r"(.*\S)\s*[\[(](.+)[\])]")  # time [ms], x (mm)


def read_table(path: Path) -> Table:
    """All columns of numbers of a CSV, MAT or Parquet file.

    A word in brackets after a name, as in ``time [ms]``, is the column's unit, known or not; the
    name is what stands before it, where no other column has that name.

    Raises
    ------
    BadRecord
        If the file is not there or no table of numbers.
    """
    readers = {".mat": _read_mat, ".parquet": _read_parquet}
    try:
        table = readers.get(path.suffix.lower(), read_csv)(path)
    except FileNotFoundError:
        raise BadRecord(f"{path}: there is no such file") from None
    except OSError as error:
        raise BadRecord(f"{path}: cannot be read: {error.strerror or error}") from error
    columns, units = {}, {}
    times = Counter(_name_and_unit(name)[0] for name in table.columns)
    for name, values in table.columns.items():
        bare, unit = _name_and_unit(name)
        own = bare if times[bare] == 1 else name
        columns[own] = values
        units[own] = unit or table.units.get(name, "")
    return Table(path, columns, {n: u for n, u in units.items() if u}, table.lines)


def _name_and_unit(name: str) -> tuple[str, str]:
    found = _WITH_UNIT.fullmatch(name.strip())
    return (found[1], found[2].strip()) if found else (name, "")


def _read_parquet(path: Path) -> Table:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise BadRecord(f"{path} {PYARROW}") from None
    if not path.is_file():
        raise FileNotFoundError
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise BadRecord(f"{path}: is no Parquet file: {str(error).splitlines()[0]}") from error
    columns = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        try:
            columns[name] = np.asarray(column.cast(pa.float64()).to_numpy(), dtype=float)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            continue  # words and dates are nobody's signal
    return Table(path, columns)


def _read_mat(path: Path) -> Table:
    from scipy.io import loadmat

    try:
        data = loadmat(path, squeeze_me=True, struct_as_record=True)
    except NotImplementedError:
        raise BadRecord(
            f"{path}: is a MAT file of version 7.3; save it with `-v7` or as CSV"
        ) from None
    except FileNotFoundError:
        raise
    except Exception as error:  # the reader raises many kinds on damaged files
        raise BadRecord(f"{path}: is no MAT file: {error}") from error
    columns: dict[str, Vector] = {}
    for name, values in data.items():
        if not name.startswith("__"):
            columns |= _vectors(name, np.asarray(values))
    return Table(path, columns)


def _vectors(name: str, array: npt.NDArray[np.generic]) -> dict[str, Vector]:
    """An array's vector of numbers; of a structure, those of its fields as ``name.field``."""
    if array.dtype.names and array.size == 1:
        whole = array.reshape(1).tolist()[0]
        fields = dict(zip(array.dtype.names, map(np.asarray, whole), strict=True))
        return {k: v for n, f in fields.items() for k, v in _vectors(f"{name}.{n}", f).items()}
    if array.dtype.kind in "fiu" and array.size == max(array.shape, default=1):
        return {name: array.astype(float).ravel()}
    return {}


def rename(
    table: Table,
    mapping: Mapping[str, str],
    known: Sequence[str],
    needed: Sequence[Sequence[str]],
) -> Table:
    """Columns under our names, in the order of ours, all of one length.

    Parameters
    ----------
    table : Table
    mapping : mapping of str to str
        ``theirs -> ours``.
    known : sequence of str
        Our names.
    needed : sequence of sequences of str
        One name at least of each has to be there.

    Raises
    ------
    BadRecord
    """
    path, columns = table.path, table.columns
    there = ", ".join(columns) or "none"
    theirs_of: dict[str, str] = {}
    for theirs, ours in mapping.items():
        if ours not in known:
            raise BadRecord(
                f"--map {theirs}={ours}: there is no {ours!r} here; columns are {', '.join(known)}"
            )
        bare, unit = _name_and_unit(theirs)
        name = bare if unit and table.units.get(bare) == unit else theirs
        if name not in columns:
            raise BadRecord(
                f"{path}: --map {theirs}={ours}: there is no column {theirs!r}"
                f"{nearest(theirs, columns)}; there are {there}"
            )
        theirs_of[ours] = name
    for name in columns:
        if name in known and name not in theirs_of.values():
            theirs_of.setdefault(name, name)
    for wanted, *others in needed:
        if not {wanted, *others} & theirs_of.keys():
            raise BadRecord(
                f"{path}: has no column {' nor '.join(map(repr, (wanted, *others)))}"
                f"{nearest(wanted, columns)}; there are "
                f"{there}; use --map theirs={wanted}"
            )
    named = {n: columns[theirs_of[n]] for n in known if n in theirs_of}
    lengths = {n: len(v) for n, v in named.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{n} {k}" for n, k in lengths.items())
        raise BadRecord(
            f"{path}: columns of different length ({said} samples): recorded at different rates? "
            "Bring them to one rate first"
        )
    units = {n: table.units[t] for n, t in theirs_of.items() if t in table.units}
    return Table(path, named, units, table.lines)


def in_si(
    table: Table,
    units: Mapping[str, str],
    quantities: Mapping[str, Sequence[str]],
    lead: float | None,
) -> tuple[dict[str, Vector], dict[str, str]]:
    """A table's columns in SI units of a linear motion, and the quantity that each measures.

    Parameters
    ----------
    table : Table
        With our names.
    units : mapping of str to str
        What the user says of columns; else the file's word counts, else SI.
    quantities : mapping of str to sequence of str
        What each of our columns may measure, the usual one first.
    lead : float or None
        Of the screw [m].

    Raises
    ------
    BadRecord
    """
    for name, text in units.items():
        if name not in quantities:
            raise BadRecord(f"--unit {name}={text}: columns are {', '.join(quantities)}")
    signals, measured = {}, {}
    for name, values in table.columns.items():
        may_be = quantities[name]
        said = units.get(name, table.units.get(name, ""))
        if not said or said in NO_UNIT:
            signals[name], measured[name] = values, may_be[0]
            continue
        if name not in units and quantity_of(said) not in may_be:
            known = ", ".join(u for q in may_be for u in UNITS[q])
            raise BadRecord(
                f"{table.path}: the file says that {name} is in {said!r}; say --unit {name}= with "
                f"one of {known}, or with a number of them, which is the size of one {said!r}"
            )
        conversion = Conversion(name, said, may_be, lead)
        signals[name], measured[name] = conversion.factor * values, conversion.quantity
    return signals, measured
