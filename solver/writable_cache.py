"""Folders that can be written, also for a user without a home folder.

Without a home, everything goes to the folder of `kernel_cache`; if no other folder is writable,
this is a private one that is removed at the end.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path

from . import kernel_cache


@cache
def ready() -> None:
    """Give matplotlib a writable folder; to be called before matplotlib is used.

    It is set in the environment, so that child processes share it. The size of SymPy's cache
    is also set there: deriving a component needs more than the usual thousand results.
    """
    os.environ.setdefault("SYMPY_CACHE_SIZE", "20000")
    if not os.environ.get("MPLCONFIGDIR") and not _matplotlib_has_folders():
        _name("MPLCONFIGDIR", kernel_cache.folder() / "matplotlib")
    if fault := kernel_cache.usual_folder()[1]:
        _name("BALLSCREW_CACHE", kernel_cache.folder())
        print(
            f"note: {fault}; equations are derived again every "
            "time; set BALLSCREW_CACHE to a folder that only you can write",
            file=sys.stderr,
        )


def _name(variable: str, folder: Path) -> None:
    os.environ[variable] = str(folder)


def _matplotlib_has_folders() -> bool:
    try:
        home = Path.home()
    except RuntimeError:
        return False
    return all(
        kernel_cache.can_be_written(Path(os.environ.get(variable) or home / usual) / "matplotlib")
        for variable, usual in (("XDG_CONFIG_HOME", ".config"), ("XDG_CACHE_HOME", ".cache"))
    )
