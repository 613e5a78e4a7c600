"""Formats of files, detected by their first bytes, not by their names."""

from __future__ import annotations

import bz2
import gzip
import io
import logging
import lzma
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ...solver.errors import BadRecord
from . import binary_tables as binary
from .columns import MOST, Table, check_size
from .csv_table import read_text
from .mat_tables import read_mat, read_mat73

_CSV = "save it as CSV"
_UNPACKED = "bytes when unpacked"
_DEEPEST = 3  # depth of packed files in packed files


class _Format(NamedTuple):
    """A format, its first bytes and its reader."""

    name: str
    magic: bytes
    reader: Callable[[Path, bytes], list[Table]]
    at: int = 0
    instead: str = _CSV
    extra: str = "records"


_HDF5 = b"\x89HDF\r\n\x1a\n"
_V7 = "save it with -v7 or as CSV"
_FORMATS = (
    _Format("a MAT-file of version 7.3", b"\0\2IM", read_mat73, 124, _V7),
    _Format("a MAT-file", b"\0\1IM", read_mat, 124, _V7),
    _Format("a MAT-file", b"\1\0MI", read_mat, 124, _V7),
    *(_Format("an HDF5 file", _HDF5, binary.read_hdf5, at) for at in (0, 512, 1024, 2048)),
    _Format("a TDMS file", b"TDSm", binary.read_tdms),
    _Format("an MDF file", b"MDF ", binary.read_mdf, instead="save it as MDF 4 or CSV"),
    _Format("an unfinished MDF file", b"UnFinMF ", binary.read_mdf),
    _Format("a Parquet file", b"PAR1", binary.read_arrow, extra="parquet"),
    _Format("an Arrow file", b"ARROW1", binary.read_arrow, extra="parquet"),
    _Format("a NumPy array", b"\x93NUMPY", binary.read_npy),
)
_PACKED: dict[bytes, tuple[str, Callable[..., Any]]] = {
    b"\x1f\x8b": ("a gzip file", gzip.open),
    b"\xfd7zXZ\0": ("an xz file", lzma.open),
    b"BZh": ("a bzip2 file", bz2.open),
}


def tables_in(path: Path, data: bytes, depth: int = 0) -> list[Table]:
    """All tables of numbers in the bytes of a file."""
    if depth > _DEEPEST:
        raise BadRecord(f"{path}: contains packed files within packed files; unpack it")
    for magic, (name, unpacked) in _PACKED.items():
        if data.startswith(magic):
            try:
                with unpacked(io.BytesIO(data)) as stream:
                    data = stream.read(MOST[_UNPACKED] + 1)
            except (OSError, EOFError, ValueError, lzma.LZMAError) as error:
                raise _damaged(path, name, error, "pack it again") from error
            check_size(path, _UNPACKED, len(data))
            return tables_in(path, data, depth + 1)
    if data.startswith(b"PK\3\4"):
        return _in_zip(path, data, depth)
    known = [f for f in _FORMATS if data.startswith(f.magic, f.at)]
    known = known if b"\0" in data else []  # a text may begin with the bytes of a format
    if not known and 0 in data[:4] and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):  # UTF-16
        known = [_Format("a MAT-file of version 4", b"", read_mat, instead=_V7)]
    return _read(path, data, known[0]) if known else read_text(path, data)


def _read(path: Path, data: bytes, known: _Format) -> list[Table]:
    said = logging.root.manager.disable
    logging.disable()  # libraries print their warnings beside our one line
    try:
        with warnings.catch_warnings(action="ignore"):
            tables = known.reader(path, data)
    except BadRecord:
        raise
    except ImportError as error:
        needs = f"needs {error.name}: pip install 'ballscrew[{known.extra}]'"
        raise BadRecord(f"{path}: is {known.name} and {needs}, or {known.instead}") from None
    except Exception as error:  # the readers raise many kinds on damaged files
        raise _damaged(path, known.name, error, known.instead) from error
    finally:
        logging.disable(said)
    if not any(t.columns for t in tables):
        raise BadRecord(f"{path}: is {known.name} without a column of numbers; {known.instead}")
    return tables


def _damaged(path: Path, name: str, error: Exception, instead: str) -> BadRecord:
    why = (str(error).splitlines() or [type(error).__name__])[0]
    return BadRecord(f"{path}: is {name} that cannot be read ({why}); {instead}")


def _in_zip(path: Path, data: bytes, depth: int) -> list[Table]:
    """Read a workbook, NumPy arrays, or the single file in an archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [n for n in archive.namelist() if not n.endswith("/")]
            check_size(path, _UNPACKED, sum(entry.file_size for entry in archive.infolist()))
            if "xl/workbook.xml" in names:
                return _read(path, data, _Format("an Excel workbook", b"", binary.read_xlsx))
            if names and all(n.endswith(".npy") for n in names):
                return _read(path, data, _Format("a NumPy archive", b"", binary.read_npz))
            if len(names) == 1:
                return tables_in(path, archive.read(names[0]), depth + 1)
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError) as error:
        excel = path.suffix.lower() in (".xlsx", ".xlsm")
        name = "an Excel workbook" if excel else "a ZIP archive"
        raise _damaged(path, name, error, _CSV if excel else "pack it again") from error
    few = f"is a ZIP archive of {len(names)} files"
    raise BadRecord(f"{path}: {few}; unpack it and give one of them, or {_CSV}")
