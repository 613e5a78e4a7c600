"""Read tables of numbers: CSV, MAT and Parquet files with columns of any name."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


class BadRecord(ValueError):
    """The file cannot be used as a record; the message says where, why and what to do."""


def read_columns(path: Path) -> dict[str, Vector]:
    """All columns of a CSV, MAT or Parquet file by the names they have there.

    Raises
    ------
    BadRecord
        If the file is not there or no table of numbers.
    """
    readers = {".mat": _read_mat, ".parquet": _read_parquet}
    try:
        return readers.get(path.suffix.lower(), _read_csv)(path)
    except FileNotFoundError:
        raise BadRecord(f"{path}: there is no such file") from None
    except OSError as error:
        raise BadRecord(f"{path}: cannot be read: {error.strerror or error}") from error


def _read_parquet(path: Path) -> dict[str, Vector]:
    import pyarrow as pa
    import pyarrow.parquet as pq

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
    return columns


def _read_csv(path: Path) -> dict[str, Vector]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as stream:
            sample = stream.read(4096)
            stream.seek(0)
            line = sample.splitlines()[0] if sample.strip() else ""
            separator = max(",;\t", key=line.count)
            rows = [r for r in csv.reader(stream, delimiter=separator) if any(c.strip() for c in r)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadRecord(f"{path}: is no text table: {error}") from error
    if not rows:
        raise BadRecord(f"{path}: is empty, expected a header row of names and rows of numbers")
    header = [name.strip() for name in rows[0]]
    if len(set(header)) < len(header):
        twice = next(n for n in header if header.count(n) > 1)
        raise BadRecord(f"{path}: the column {twice!r} is there twice")
    table = np.empty((len(rows) - 1, len(header)))
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise BadRecord(f"{path}, row {number}: {len(row)} cells, expected {len(header)}")
        for k, cell in enumerate(row):
            try:
                table[number - 2, k] = float(cell) if cell.strip() else math.nan
            except ValueError:
                raise BadRecord(
                    f"{path}, row {number}, column {header[k]!r}: {cell!r} is no number"
                ) from None
    return {name: table[:, k].copy() for k, name in enumerate(header)}


def _read_mat(path: Path) -> dict[str, Vector]:
    from scipy.io import loadmat

    try:
        data = loadmat(path)
    except NotImplementedError:
        raise BadRecord(
            f"{path}: is a MAT file of version 7.3; save it with `-v7` or as CSV"
        ) from None
    except FileNotFoundError:
        raise
    except Exception as error:  # the reader raises many kinds on damaged files
        raise BadRecord(f"{path}: is no MAT file: {error}") from error
    columns = {}
    for name, values in data.items():
        array = np.asarray(values)
        if (
            not name.startswith("__")
            and array.dtype.kind in "fiu"
            and array.size == max(array.shape, default=0)
        ):
            columns[name] = array.astype(float).ravel()
    return columns


def renamed(
    path: Path,
    columns: Mapping[str, Vector],
    mapping: Mapping[str, str],
    known: Sequence[str],
    needed: Sequence[Sequence[str]],
    if_unequal: str,
) -> dict[str, Vector]:
    """Columns under our names, in the order of ours, all of one length.

    Parameters
    ----------
    mapping : mapping of str to str
        ``theirs -> ours``.
    known : sequence of str
        Our names.
    needed : sequence of sequences of str
        One name at least of each has to be there.
    if_unequal : str
        What to say where lengths differ.

    Raises
    ------
    BadRecord
    """
    there = ", ".join(columns) or "none"
    for theirs, ours in mapping.items():
        if ours not in known:
            raise BadRecord(
                f"--map {theirs}={ours}: there is no {ours!r} here; columns are {', '.join(known)}"
            )
        if theirs not in columns:
            raise BadRecord(
                f"{path}: --map {theirs}={ours}: there is no column {theirs!r}"
                f"{near(theirs, columns)}; there are {there}"
            )
    taken = set(mapping.values())
    named = {n: v for n, v in columns.items() if n not in mapping and n not in taken}
    named |= {ours: columns[theirs] for theirs, ours in mapping.items()}
    named = {n: named[n] for n in known if n in named}
    for wanted, *others in needed:
        if not {wanted, *others} & named.keys():
            raise BadRecord(
                f"{path}: has no column {wanted!r}{near(wanted, columns)}; there are "
                f"{there}; use --map theirs={wanted}"
            )
    lengths = {n: len(v) for n, v in named.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{n} {k}" for n, k in lengths.items())
        raise BadRecord(f"{path}: columns of different length ({said} samples){if_unequal}")
    return named


def check_forwards(name: Path | str, time: Vector) -> Vector:
    """The steps of a time that only grows [s], shape (n - 1,).

    Raises
    ------
    BadRecord
        If it does not.
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        k = int(back[0])
        what = "stands still" if steps[k] == 0 else "goes backwards"
        raise BadRecord(
            f"{name}: time {what} in row {k + 3}: {time[k + 1]:.6g} s after {time[k]:.6g} s"
        )
    return steps


def near(name: str, names: object) -> str:
    """The names that look like `name`, in brackets, for a complaint."""
    close = difflib.get_close_matches(name, list(names), n=3, cutoff=0.4)  # type: ignore[call-overload]
    return f" (nearest: {', '.join(close)})" if close else ""
