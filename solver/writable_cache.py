"""Folders that can be written, also for a user without a home.

Then everything goes to the folder of `kernel_cache`, which is a private one, removed at the end,
where nothing else can be written.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path

from . import kernel_cache


@cache
def ready() -> None:
    """Name a folder to matplotlib that it can write; to be called before it is used.

    It is named in the environment, so that processes which this one starts share it. So is how much
    SymPy remembers: deriving a component asks for more than its usual thousand results again.
    """
    os.environ.setdefault("SYMPY_CACHE_SIZE", "20000")
    if not os.environ.get("MPLCONFIGDIR") and not _matplotlib_has_folders():
        _name("MPLCONFIGDIR", kernel_cache.folder() / "matplotlib")
    if fault := kernel_cache.usual_folder()[1]:
        _name("BALLSCREW_CACHE", kernel_cache.folder())
        print(
            f"note: {fault}; equations are derived anew every time; "
            "set BALLSCREW_CACHE to a folder that only you can write",
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
