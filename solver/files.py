"""Files of results: written whole or not at all, and strict JSON."""

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
_PATIENCE = 2.0  # s, for who reads what Windows is to replace
_PAUSE = 0.02  # s


@contextlib.contextmanager
def naming(place: Path) -> Iterator[None]:
    """Let an error of the system, such as a full disk, say where; raises it."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(place)
        raise


def replace(source: Path | str, target: Path | str) -> None:
    """Rename, in place of what has that name; raises OSError.

    Windows refuses while somebody has the old file open, such as another worker that reads it or a
    virus scanner: that is waited for.
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
    """A folder that goes at the end of a ``with``; what Windows has loaded from it stays."""
    windows = sys.platform == "win32"
    return tempfile.TemporaryDirectory(
        prefix=f"ballscrew-{purpose}-", ignore_cleanup_errors=windows
    )


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write beside, then rename: a reader sees the old content or the new, never half.

    What is large may come in pieces.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with naming(path), os.fdopen(handle, "wb") as stream:
            stream.writelines([data] if isinstance(data, bytes) else data)
            stream.flush()
            os.fsync(stream.fileno())  # else a power cut may leave the new name without content
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
