"""Files of results: written completely or not at all, and strict JSON."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

_UMASK = os.umask(0o022)
os.umask(_UMASK)
_PATIENCE = 2.0  # s, waiting for readers of a file that Windows is to replace
_PAUSE = 0.02  # s


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
    windows = sys.platform == "win32"
    return tempfile.TemporaryDirectory(
        prefix=f"ballscrew-{purpose}-", ignore_cleanup_errors=windows
    )


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
