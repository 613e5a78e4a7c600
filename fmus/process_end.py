"""Let a process that hosted a pythonfmu FMU end without a crash.

The library of pythonfmu 0.7 releases its static interpreter state twice while the process ends, the
second time after it is freed, which sometimes aborts a process after its work is done. Releasing it
once, before the others, avoids that. This file imports nothing of the package: it is also part of
every exported FMU.
"""

from __future__ import annotations

import atexit
import ctypes
import sys
from pathlib import Path
from typing import Any

_LIBRARIES: dict[str, Any] = {}


def end_cleanly(library: Path) -> None:
    """Keep the FMU's library loaded, and release its interpreter state before the process ends."""
    path = str(library)
    if path in _LIBRARIES or not sys.platform.startswith("linux"):
        return
    try:
        handle = ctypes.CDLL(path)
        release = handle.finalizePythonInterpreter
    except (OSError, AttributeError):
        return  # not a pythonfmu FMU, or one of another version: nothing to correct
    _LIBRARIES[path] = handle
    atexit.register(release)
