"""Import a generated module from a per-user folder, so that numba compiles each only once.

numba keys its on-disk cache by the path of the file. Modules whose names end in a hash of their
content are therefore written to one fixed folder and imported from there. This file stands alone:
it also goes into every FMU, which then shares the compiled code of the project and of its twins.
"""

from __future__ import annotations

import atexit
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import ModuleType

_UMASK = os.umask(0o022)
os.umask(_UMASK)


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


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write beside, then rename: a reader sees the old content or the new, never half.

    What is large may come in pieces.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.writelines([data] if isinstance(data, bytes) else data)
        os.chmod(name, 0o666 & ~_UMASK)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def load_file(path: Path) -> ModuleType:
    """Import a module from a file whose name is unique to its content.

    The file is read only the first time: an FMU's folder may be gone when the next instance comes.
    """
    return sys.modules.get(path.stem) or load(path.stem, path.read_text(encoding="utf-8"))


def load(name: str, text: str) -> ModuleType:
    """Import the module `name` whose source is `text`; `name` must be unique to that text.

    A file that is there already is used only if its content is exactly the given text.
    """
    if name in sys.modules:
        return sys.modules[name]
    data = text.encode("utf-8")
    path = folder() / "kernels" / f"{name}.py"
    try:
        if not path.is_file() or path.read_bytes() != data:
            write_atomically(path, data)
    except OSError:  # a full disk: compile anew in every process, from a private folder
        path = _private_folder() / f"{name}.py"
        path.write_bytes(data)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot import {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module
