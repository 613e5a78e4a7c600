"""Zip files: unpack any zip file safely into a new folder; pack our own."""

from __future__ import annotations

import errno
import io
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

LARGEST = 2 * 1024**3  # largest size of an unpacked archive in bytes
LARGEST_OF_ALL = 8 * 1024**3  # the same, for all archives of one system together
MOST = 100_000  # files in it
_FIXED_TIME = (1980, 1, 1, 0, 0, 0)


class BadArchive(ValueError):
    """The file cannot be unpacked; the message says why, without the file's name."""


def unpack_archive(path: Path) -> Path:
    """Unpack a zip file into a new temporary folder, which the caller must remove.

    Raises
    ------
    BadArchive
        If the file is missing, is no zip file, is damaged, names files outside its folder, or would
        unpack to more than two gibibytes.
    """
    try:
        if not path.is_file():
            raise BadArchive("is a folder" if path.is_dir() else "no such file")
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise BadArchive(f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a name with a null character; BadZipFile is no ValueError
        if isinstance(error, BadArchive):
            raise
        raise BadArchive(f"cannot be read: {error}") from error
    except Exception as error:  # zipfile raises many kinds of errors for damaged files
        raise BadArchive("is not a zip file") from error
    with archive:
        entries = archive.infolist()
        if not entries:
            raise BadArchive("is an empty zip file")
        for entry in entries:
            _check_name(entry.filename)
        size = sum(entry.file_size for entry in entries)
        if size > LARGEST or len(entries) > MOST:
            raise BadArchive(
                f"would unpack to {size / 1024**3:.1f} GiB in {len(entries)} files, expected at "
                f"most {LARGEST / 1024**3:.0f} GiB in {MOST}"
            )
        folder = Path(tempfile.mkdtemp(prefix="ballscrew-"))
        try:
            # extractall writes the target of a symbolic link in the archive as plain text
            archive.extractall(folder)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            where = f" into {folder.parent}" if error.errno == errno.ENOSPC else ""
            raise BadArchive(f"cannot be unpacked{where}: {error.strerror or error}") from error
        except BaseException as error:
            shutil.rmtree(folder, ignore_errors=True)
            if not isinstance(error, Exception):
                raise
            raise BadArchive(f"is damaged: {error or type(error).__name__}") from error
    return folder


def unpacked_size(path: Path) -> int:
    """Unpacked size of an archive in bytes, as declared in it; raises BadZipFile, OSError."""
    with zipfile.ZipFile(path) as archive:
        return sum(entry.file_size for entry in archive.infolist())


def _check_name(name: str) -> None:
    parts = PurePosixPath(name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts or ":" in name:
        raise BadArchive(f"holds {name!r}, which is outside its folder; nothing was unpacked")


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
