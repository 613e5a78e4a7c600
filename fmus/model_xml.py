"""Checks of a third party's XML before it goes to a parser that builds trees.

Entities can grow without bound or read other files. No FMU and no system needs them, so a file that
declares a document type is refused; the declaration must come before the first element.
"""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO, cast
from xml.parsers import expat

LARGEST = 256 * 1024**2  # bytes; their tree is about ten times as large
_PIECE = 1 << 16
_DESCRIPTIONS = ("modelDescription.xml", "sources/buildDescription.xml")


class BadXml(ValueError):
    """The file is not XML that can be read here; the message says why."""


def first_element(stream: BinaryIO, name: str) -> dict[str, str]:
    """Attributes of the first element.

    Parameters
    ----------
    stream : binary file
    name : str
        Name of the file in messages.

    Raises
    ------
    BadXml
        If it declares a document type, or the text before the first element is not XML.
    """
    found: list[dict[str, str]] = []

    def refuse(*_: object) -> None:
        raise BadXml(f"{name} declares a document type, which FMUs and systems have no use for")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda _, attributes: found.append(attributes)
    try:
        while not found:
            piece = stream.read(_PIECE)
            parser.Parse(piece, not piece)
    except (expat.ExpatError, LookupError, ValueError) as error:
        if isinstance(error, BadXml):
            raise
        if not found:  # later errors are reported by the parser of the whole file
            raise BadXml(f"{name} is no XML: {error}") from error
    return found[0]


def check_file(file: Path) -> dict[str, str]:
    """As `first_element`, for a file; also refuse a file that is too large for a tree.

    Raises
    ------
    BadXml
    OSError
    """
    check_size(file.stat().st_size, file.name)
    with file.open("rb") as stream:
        return first_element(stream, file.name)


def check_lines(names: Iterable[str]) -> None:
    """Refuse names of more than one line, which the schemas do not allow; raises `BadXml`."""
    for name in names:
        if name.splitlines() not in ([], [name]):
            raise BadXml(f"the name {name!r} has a line break")


def check_size(size: int, name: str) -> None:
    """Refuse a size that is too large for a tree; raises `BadXml`."""
    if size > LARGEST:
        raise BadXml(f"{name} has {size / 1024**2:.0f} MiB, expected at most {LARGEST >> 20}")


def check_archive(stream: BinaryIO) -> None:
    """As `check_file`, for the descriptions in a packed FMU; other files are not checked."""
    with contextlib.suppress(zipfile.BadZipFile), zipfile.ZipFile(stream) as archive:
        for name in {*_DESCRIPTIONS} & {*archive.namelist()}:
            check_size(archive.getinfo(name).file_size, name)
            with archive.open(name) as content:
                first_element(cast("BinaryIO", content), name)
