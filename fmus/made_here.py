"""Which FMUs this program wrote on this machine, known by their content.

They run in the master's own process. Every other FMU is treated as a third-party program.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from pathlib import Path

from ..solver import kernel_cache


def remember(path: Path) -> None:
    """Store that this program wrote the FMU."""
    # if not stored, it runs in its own process: slower, with the same results
    with contextlib.suppress(OSError):
        kernel_cache.write(_note(path), b"")


def is_ours(path: Path) -> bool:
    """Whether a file is, byte for byte, an FMU written by this program, in any folder."""
    try:
        return kernel_cache.is_whole(_note(path))
    except OSError:
        return False


def is_kept(path: Path) -> bool:
    """Whether an FMU of the user's cache exists and is unchanged."""
    return kernel_cache.is_whole(path) and is_ours(path)


def keep(path: Path, write: Callable[[], object]) -> Path:
    """Let `write` put an FMU into the user's cache, and replace an old one.

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
