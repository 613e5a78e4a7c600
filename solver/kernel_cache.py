"""A per-user folder for what need not be made twice."""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path


def folder() -> Path:
    """The cache folder: the user's, or this process' own where that cannot be written."""
    return usual_folder() or _private_folder()


def usual_folder() -> Path | None:
    """The per-user cache folder; None where it cannot be written.

    ``BALLSCREW_CACHE`` overrides the platform's place.
    """
    try:
        if os.environ.get("BALLSCREW_CACHE"):
            place = Path(os.environ["BALLSCREW_CACHE"])
        elif sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
            place = Path(base) / "ballscrew"
        elif sys.platform == "darwin":
            place = Path.home() / "Library" / "Caches" / "ballscrew"
        else:
            place = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ballscrew"
    except RuntimeError:  # a user without a home
        return None
    return place if can_be_written(place) else None


def compiled_path(module: str) -> Path:
    """Where the compiled equations of a module are, if they are anywhere."""
    return folder() / "equations" / f"{module}_{_way_of_compiling()}.so"


@cache
def _way_of_compiling() -> str:
    """Hash of what decides how equations are compiled: those of another version are not taken."""
    here = Path(__file__).parent
    names = ("c/system.h", "translation.py", "compiled_equations.py", "compilers.py")
    return hashlib.sha256(b"\0".join((here / n).read_bytes() for n in names)).hexdigest()[:8]


def hashed_name(stem: str, text: str) -> str:
    """A module name that no other content can have."""
    return f"{stem}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def can_be_written(place: Path) -> bool:
    """Whether a folder is there, or can be made, and takes files."""
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(place, os.W_OK | os.X_OK)


@cache
def _private_folder() -> Path:
    """A folder that only this user can read, for this process and those it starts."""
    place = Path(tempfile.mkdtemp(prefix="ballscrew-"))
    atexit.register(_remove, place, os.getpid())
    return place


def _remove(place: Path, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(place, ignore_errors=True)
