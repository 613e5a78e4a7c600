"""A per-user cache folder.

Code is loaded from it, so it is used only if nobody except its user and root can write to it.
Each entry has a digest: a damaged entry counts as missing and is made again. If no other folder can
be written, everything, also of Matplotlib, goes to a private one that is removed at the end.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from .files import write_atomically

COMPONENTS, EQUATIONS = "components", "equations"
FMUS, MADE, COMPILED = "fmus", "fmus/made", "fmus/compiled"
_FOLDERS = (COMPONENTS, EQUATIONS, FMUS, MADE, COMPILED)
_DIGEST = ".sha256"
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_UNREADABLE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # links, pipes


def folder() -> Path:
    """The cache folder of the user; if it cannot be used, one of this process."""
    place, fault = usual_folder()
    return _private_folder() if fault else place


def usual_folder() -> tuple[Path, str]:
    """The per-user cache folder, and why it cannot be used; empty if it can.

    ``BALLSCREW_CACHE`` overrides the default place of the platform.
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
    except RuntimeError:  # a user without a home folder
        return Path(), "no cache folder can be written"
    place = Path(os.path.realpath(place))  # a link may change its target later
    return place, _fault(place)


@cache
def _fault(place: Path) -> str:
    """Why a folder cannot be used; it is created if possible."""
    if not can_be_written(place):
        return "no cache folder can be written"
    for own in (place, *(Path(os.path.realpath(place / name)) for name in _FOLDERS)):
        for above in (own, *own.parents):
            if who := _who_else_writes(above, above != own):
                return f"the cache folder is not used: {who}"
    return ""


def _who_else_writes(place: Path, sticky: bool = False) -> str:
    """Which other users can write a file or folder, in words; empty if none, or no such file.

    In a `sticky` folder such as ``/tmp`` others can write, but cannot replace existing files.
    """
    if sys.platform == "win32":  # a user's profile is closed to others
        return ""
    try:
        found = place.lstat()
    except OSError:
        return ""
    if found.st_uid not in (0, os.geteuid()):
        return f"{place} belongs to another user"
    if stat.S_ISLNK(found.st_mode) or not found.st_mode & _OTHERS:
        return ""
    if sticky and found.st_mode & stat.S_ISVTX:
        return ""
    return f"other users can write {place}"


def entry(kind: str, name: str) -> Path:
    """Path of an entry: its kind, such as `COMPONENTS`, and its name."""
    return folder() / kind / name


def read(path: Path) -> bytes | None:
    """Content of an entry; None if it is missing, changed, or of another user."""
    data, digest = _content(path), _content(_digest_of(path))
    return data if digest is not None and digest == _digest(data) else None


def is_whole(path: Path) -> bool:
    """Whether an entry exists and is unchanged."""
    return read(path) is not None


def write(path: Path, data: bytes) -> None:
    """Store an entry, and replace an old one.

    Raises
    ------
    OSError
    """
    make_way(path)
    write_atomically(path, data)
    seal(path, data)


def kept(path: Path, make: Callable[[], bytes]) -> bytes:
    """Content of an entry, made if it does not exist; a full disk costs time, not results."""
    if (data := read(path)) is None:
        data = make()
        with contextlib.suppress(OSError):
            write(path, data)
    return data


def seal(path: Path, data: bytes | None = None) -> None:
    """Write the digest of an entry that was written elsewhere; raises OSError."""
    path.chmod(stat.S_IRUSR | stat.S_IWUSR)
    beside = _digest_of(path)
    make_way(beside)
    write_atomically(beside, _digest(path.read_bytes() if data is None else data))
    beside.chmod(stat.S_IRUSR | stat.S_IWUSR)


def make_way(path: Path) -> None:
    """Make an entry's folder, and remove a folder of the entry's name; raises OSError."""
    for place in (path.parent.parent, path.parent):
        if os.path.lexists(place) and not place.is_dir():
            place.unlink()
        _make(place)
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)


def _make(place: Path) -> None:
    """Make a folder and its parents so that only this user can open them, for any umask."""
    for missing in reversed([p for p in (place, *place.parents) if not p.exists()]):
        missing.mkdir(exist_ok=True)
        missing.chmod(stat.S_IRWXU)


def _digest_of(path: Path) -> Path:
    return path.with_name(path.name + _DIGEST)


def _digest(data: bytes | None) -> bytes:
    return b"" if data is None else hashlib.sha256(data).hexdigest().encode()


def _content(path: Path) -> bytes | None:
    """Content of a file that nobody else can write."""
    with (
        contextlib.suppress(OSError),
        open(os.open(path, os.O_RDONLY | _UNREADABLE), "rb") as stream,
    ):
        if who := _who_else_writes(path):
            print(f"note: an entry of the cache is made again: {who}", file=sys.stderr)
        elif stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return stream.read()
    return None


def compiled_path(module: str) -> Path:
    """Path of the compiled equations of a module, if they exist."""
    return entry(EQUATIONS, f"{module}_{_way_of_compiling()}.so")


@cache
def _way_of_compiling() -> str:
    """Hash of everything that affects compiled equations; other versions are not used."""
    here = Path(__file__).parent
    names = ("c/system.h", "translation.py", "compilers.py")
    return hashlib.sha256(b"\0".join((here / n).read_bytes() for n in names)).hexdigest()[:8]


def hashed_name(stem: str, text: str) -> str:
    """A module name that is unique for this content."""
    return f"{stem}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def can_be_written(place: Path) -> bool:
    """Whether a folder exists, or can be made, and is writable."""
    try:
        _make(place)
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


@cache
def ready() -> None:
    """Give matplotlib a writable folder; to be called before matplotlib is used.

    It is set in the environment, so that child processes share it. The size of SymPy's cache
    is also set there: deriving a component needs more than the usual thousand results.
    """
    os.environ.setdefault("SYMPY_CACHE_SIZE", "20000")
    if not os.environ.get("MPLCONFIGDIR") and not _matplotlib_has_folders():
        os.environ["MPLCONFIGDIR"] = str(folder() / "matplotlib")
    if fault := usual_folder()[1]:
        os.environ["BALLSCREW_CACHE"] = str(folder())
        print(
            f"note: {fault}; equations are derived again every "
            "time; set BALLSCREW_CACHE to a folder that only you can write",
            file=sys.stderr,
        )


def _matplotlib_has_folders() -> bool:
    usual = {"XDG_CONFIG_HOME": ".config", "XDG_CACHE_HOME": ".cache"}
    with contextlib.suppress(RuntimeError):  # a user without a home folder
        places = [Path(os.environ.get(v) or Path.home() / usual[v]) for v in usual]
        return all(can_be_written(place / "matplotlib") for place in places)
    return False
