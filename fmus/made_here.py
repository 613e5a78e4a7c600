"""Which FMUs this program wrote on this machine, known by their content.

They run in the master's own process. Anything else is a third-party program, whatever its name.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from pathlib import Path

from ..solver import kernel_cache


def remember(path: Path) -> None:
    """Note that this program wrote the FMU."""
    # not noted, it runs in a process of its own: slower, and as right
    with contextlib.suppress(OSError):
        kernel_cache.write(_note(path), b"")


def is_ours(path: Path) -> bool:
    """Whether a file is, byte for byte, an FMU that this program wrote, wherever it lies."""
    try:
        return kernel_cache.is_whole(_note(path))
    except OSError:
        return False


def is_kept(path: Path) -> bool:
    """Whether an FMU of the user's cache is there, as it was written."""
    return kernel_cache.is_whole(path) and is_ours(path)


def keep(path: Path, write: Callable[[], object]) -> Path:
    """Let `write` put an FMU into the user's cache, in place of whatever is there.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    kernel_cache.make_way(path)
    write()
    kernel_cache.seal(path)
    return path


def _note(path: Path) -> Path:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return kernel_cache.entry(kernel_cache.MADE, digest)
