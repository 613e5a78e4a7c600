"""Tables of results: Parquet if pyarrow is installed, else CSV with the same columns."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .files import replace

Columns = Mapping[str, Sequence[Any]]  # numbers, words or truth values of one length; None: unknown
PYARROW = "needs pyarrow: pip install 'ballscrew[parquet]', or use .csv"


class BadTable(Exception):
    """A table that cannot be read; the message is one line."""


class NoPyarrow(BadTable):
    """A Parquet file, and no pyarrow to read it."""


def table_path(folder: Path, stem: str) -> Path:
    """Path of the table in a folder, in its present format, or the path to write it to."""
    parquet, text = folder / f"{stem}.parquet", folder / f"{stem}.csv"
    if parquet.is_file() or (importlib.util.find_spec("pyarrow") and not text.is_file()):
        return parquet
    return text


def write_table(folder: Path, stem: str, pieces: Iterable[Columns]) -> Path:
    """Write a table of rows given in pieces; one piece at a time is in memory.

    Returns
    -------
    Path
        ``stem.parquet`` or, without pyarrow, ``stem.csv`` in the folder.
    """
    (folder / f"{stem}.csv").unlink(missing_ok=True)
    (folder / f"{stem}.parquet").unlink(missing_ok=True)
    path = table_path(folder, stem)
    half = path.with_name(path.name + ".part")
    (_write_parquet if path.suffix == ".parquet" else _write_csv)(half, pieces)
    replace(half, path)
    return path


def _write_parquet(path: Path, pieces: Iterable[Columns]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    writer = None
    for columns in pieces:
        if writer is None:
            types = {name: pa.array(values).type for name, values in columns.items()}
            unknown = [name for name, kind in types.items() if kind == pa.null()]
            schema = pa.schema(types | dict.fromkeys(unknown, pa.float64()))
            writer = pq.ParquetWriter(path, schema)
        writer.write_table(pa.table(dict(columns), schema=schema))
    if writer:
        writer.close()


def _write_csv(path: Path, pieces: Iterable[Columns]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        for k, columns in enumerate(pieces):
            if k == 0:
                writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))


def read_table(path: Path) -> dict[str, list[Any]]:
    """The columns written by `write_table`; an empty word is None in both formats.

    Raises
    ------
    BadTable
        If the file is damaged, or is Parquet and there is no pyarrow.
    """
    if path.suffix == ".csv":
        try:
            with path.open(encoding="utf-8", newline="") as stream:
                names, *rows = csv.reader(stream)
            cells = zip(*([_value(text) for text in row] for row in rows), strict=True)
            return dict(zip(names, map(list, cells), strict=True))
        except ValueError as error:
            raise BadTable(f"{path} is damaged") from error
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise NoPyarrow(f"{path} {PYARROW}") from None
    try:
        found: dict[str, list[Any]] = pq.read_table(path).to_pydict()
        found = {n: [None if v == "" else v for v in column] for n, column in found.items()}
    except (OSError, pa.ArrowInvalid) as error:
        raise BadTable(f"{path} is damaged") from error
    return found


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return {"": None, "True": True, "False": False}.get(text, text)
