"""Files of results, written completely or not at all: strict JSON, and tables.

Tables are Parquet if pyarrow is installed, else CSV with the same columns.
"""

from __future__ import annotations

import contextlib
import csv
import importlib.util
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

_UMASK = os.umask(0o022)
os.umask(_UMASK)
_PATIENCE = 2.0  # s, waiting for readers of a file that Windows is to replace
_PAUSE = 0.02  # s

Columns = Mapping[str, Sequence[Any]]  # numbers, words or truth values of one length; None: unknown
PYARROW = "needs pyarrow: pip install 'ballscrew[parquet]', or use .csv"


def readable(text: str) -> str:
    """The text with file names in UTF-8, also if the locale does not have their characters."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


@contextlib.contextmanager
def naming(place: Path) -> Iterator[None]:
    """Add the file name to an error of the system, such as a full disk; raises it."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(place)
        raise


def replace(source: Path | str, target: Path | str) -> None:
    """Rename, and replace a file of that name; raises OSError.

    Windows refuses while the old file is open in another process, such as a worker or a virus
    scanner: this function waits for it.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if sys.platform != "win32" or time.monotonic() > deadline:
                raise
            time.sleep(_PAUSE)


def temporary_folder(purpose: str) -> tempfile.TemporaryDirectory[str]:
    """A folder that is removed at the end of a ``with``; libraries loaded by Windows remain."""
    prefix, windows = f"ballscrew-{purpose}-", sys.platform == "win32"
    return tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=windows)


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a temporary file, then rename it: a reader sees the old content or the new, never half.

    Large content may be given in pieces.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with naming(path), os.fdopen(handle, "wb") as stream:
            stream.writelines([data] if isinstance(data, bytes) else data)
            stream.flush()
            # otherwise a power failure may leave an empty file of the new name
            os.fsync(stream.fileno())
        os.chmod(name, 0o666 & ~_UMASK)
        replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON: numbers that are not finite become null."""
    write_atomically(path, (json.dumps(finite_or_null(data), indent=2) + "\n").encode())


def finite_or_null(data: Any) -> Any:
    """The same data with None for every number that strict JSON cannot write."""
    if isinstance(data, dict):
        return {key: finite_or_null(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite_or_null(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


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
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    def array(values: Any, kind: Any = None) -> Any:
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "bif":
            return pa.array(values, kind)  # loads pandas, for 0.3 s
        data = np.packbits(values, bitorder="little") if values.dtype == bool else values.copy()
        buffers = [None, pa.py_buffer(data)]
        return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), buffers)

    writer = None
    for columns in pieces:
        if writer is None:
            types = {name: array(values).type for name, values in columns.items()}
            known = {n: pa.float64() if kind == pa.null() else kind for n, kind in types.items()}
            schema = pa.schema(known)
            writer = pq.ParquetWriter(path, schema)
        arrays = [array(columns[field.name], field.type) for field in schema]
        writer.write_table(pa.table(arrays, schema=schema))
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
    except (OSError, pa.ArrowInvalid) as error:
        raise BadTable(f"{path} is damaged") from error
    return {n: [None if v == "" else v for v in column] for n, column in found.items()}


def _value(text: str) -> Any:
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return {"": None, "True": True, "False": False}.get(text, text)
