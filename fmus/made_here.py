"""Which FMUs this program wrote on this machine, known by their content.

They run in the master's own process. Anything else is a third-party program, whatever its name.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

from ..solver import kernel_cache
from ..solver.files import write_atomically


def remember(path: Path) -> None:
    """Note that this program wrote the FMU."""
    # not noted, it runs in a process of its own: slower, and as right
    with contextlib.suppress(OSError):
        write_atomically(_note(path), b"")


def is_ours(path: Path) -> bool:
    """Whether a file is, byte for byte, an FMU that this program wrote, wherever it lies."""
    try:
        return _note(path).is_file()
    except OSError:
        return False


def _note(path: Path) -> Path:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return kernel_cache.folder() / "fmus" / "made" / digest
