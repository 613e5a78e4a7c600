"""Zip and XML files: those of others read safely, our own written.

XML is checked before it goes to a parser that builds trees: entities can grow without bound or
read other files. No FMU and no system needs them, so a file that declares a document type is
refused; the declaration must come before the first element.
"""

from __future__ import annotations

import errno
import io
import math
import shutil
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import IO
from xml.etree import ElementTree as ET
from xml.parsers import expat

from ..solver.errors import FmuError

LARGEST = 2 * 1024**3  # largest size of an unpacked archive in bytes
LARGEST_OF_ALL = 8 * 1024**3  # the same, for all archives of one system together
MOST = 100_000  # files in it
LARGEST_XML = 256 * 1024**2  # bytes; their tree is about ten times as large
_FIXED_TIME = (1980, 1, 1, 0, 0, 0)


def open_archive(path: Path) -> zipfile.ZipFile:
    """Open a zip file for reading.

    Raises
    ------
    FmuError
        If the file is missing, is no zip file, names files outside its folder, or would unpack to
        more than two gibibytes.
    """
    try:
        if not path.is_file():
            raise FmuError("is a folder" if path.is_dir() else "no such file")
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise FmuError(f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a name with a null character; BadZipFile is no ValueError
        if isinstance(error, FmuError):
            raise
        raise FmuError(f"cannot be read: {error}") from error
    except Exception as error:  # zipfile raises many kinds of errors for damaged files
        raise FmuError("is not a zip file") from error
    try:
        _check_entries(archive.infolist())
    except FmuError:
        archive.close()
        raise
    return archive


def _check_entries(entries: list[zipfile.ZipInfo]) -> None:
    if not entries:
        raise FmuError("is an empty zip file")
    for name in (entry.filename for entry in entries):
        parts = PurePosixPath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name:
            raise FmuError(f"holds {name!r}, which is outside its folder; nothing was unpacked")
    size = sum(entry.file_size for entry in entries)
    if size > LARGEST or len(entries) > MOST:
        raise FmuError(
            f"would unpack to {size / 1024**3:.1f} GiB in {len(entries)} files, expected at "
            f"most {LARGEST / 1024**3:.0f} GiB in {MOST}"
        )


def unpack_archive(path: Path) -> Path:
    """Unpack a zip file into a new temporary folder, which the caller must remove.

    Raises
    ------
    FmuError
        See `open_archive`; also if it is damaged or cannot be written.
    """
    with open_archive(path) as archive:
        folder = Path(tempfile.mkdtemp(prefix="ballscrew-"))
        try:
            # extractall writes the target of a symbolic link in the archive as plain text
            archive.extractall(folder)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            where = f" into {folder.parent}" if error.errno == errno.ENOSPC else ""
            raise FmuError(f"cannot be unpacked{where}: {error.strerror or error}") from error
        except BaseException as error:
            shutil.rmtree(folder, ignore_errors=True)
            if not isinstance(error, Exception):
                raise
            raise FmuError(f"is damaged: {error or type(error).__name__}") from error
    return folder


def unpacked_size(path: Path) -> int:
    """Unpacked size of an archive in bytes, as declared in it; raises BadZipFile, OSError."""
    with zipfile.ZipFile(path) as archive:
        return sum(entry.file_size for entry in archive.infolist())


def pack(files: Mapping[str, bytes]) -> bytes:
    """Bytes of a zip file; the same files in the same order give the same bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, _FIXED_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            entry.create_system = 3
            archive.writestr(entry, data)
    return stream.getvalue()


def first_element(stream: IO[bytes], size: int, name: str) -> dict[str, str]:
    """Attributes of the first element of a file of this size; its name is for messages.

    Raises
    ------
    FmuError
        If it is too large for a tree, declares a document type, or the text before the first
        element is not XML.
    """
    if size > LARGEST_XML:
        raise FmuError(f"{name} has {size / 1024**2:.0f} MiB, expected at most {LARGEST_XML >> 20}")
    found: list[dict[str, str]] = []

    def refuse(*_: object) -> None:
        raise FmuError(f"{name} declares a document type, which FMUs and systems have no use for")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda _, attributes: found.append(attributes)
    try:
        while not found:
            piece = stream.read(1 << 16)
            parser.Parse(piece, not piece)
    except (expat.ExpatError, LookupError, ValueError) as error:
        if isinstance(error, FmuError):
            raise
        if not found:  # later errors are reported by the parser of the whole file
            raise FmuError(f"{name} is no XML: {error}") from error
    return found[0]


def check_lines(names: Iterable[str]) -> None:
    """Refuse names of more than one line, which the schemas do not allow; raises `FmuError`."""
    for name in names:
        if name.splitlines() not in ([], [name]):
            raise FmuError(f"the name {name!r} has a line break")


def number(text: str | None, what: str) -> float:
    """A finite number; raises `FmuError`."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in str(text):
        raise FmuError(f"{what} is {text!r}, expected a finite number")
    return value


def xml_text(root: ET.Element) -> bytes:
    """Our own XML with a declaration and indented."""
    ET.indent(root)
    text: str = ET.tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()
