"""Folders for compiled code, also where the usual ones cannot be written.

A user without a home, and a package that somebody else installed, leave numba no place for what it
compiles, and it refuses to work. Then it gets the folder of `kernel_cache`, which is a private one,
removed at the end, where nothing else can be written.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path

from . import kernel_cache


@cache
def ready() -> None:
    """Name folders to numba and matplotlib that they can write; to be called before they are used.

    They are named in the environment, so that processes which this one starts share them.
    """
    beside_sources = Path(__file__).parent / "__pycache__"
    named = os.environ.get("NUMBA_CACHE_DIR")
    if not (named and kernel_cache.can_be_written(Path(named))) and not (
        kernel_cache.can_be_written(beside_sources)
    ):
        _name("NUMBA_CACHE_DIR", kernel_cache.folder() / "numba")
        if "numba" in sys.modules:  # it has read its settings already
            sys.modules["numba"].config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]
    if not os.environ.get("MPLCONFIGDIR") and not _matplotlib_has_folders():
        _name("MPLCONFIGDIR", kernel_cache.folder() / "matplotlib")
    if kernel_cache.usual_folder() is None:
        _name("BALLSCREW_CACHE", kernel_cache.folder())
        print(
            "note: no cache folder can be written, so that first runs compile anew every time; "
            "set BALLSCREW_CACHE to a folder that you can write",
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
