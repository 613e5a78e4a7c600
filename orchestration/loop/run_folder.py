"""A folder contains the results of one run: all of them or none, and nothing of previous runs.

Results are first written into a hidden folder inside. A list of them is put in place by one
renaming; from this instant on, the folder holds the new run. Then each file is renamed to its
place, and files that only the previous run wrote are removed; if this process is killed, the next
one finishes this. The list has a digest of each file: a file that is not as we wrote it is the
user's, and is never removed or overwritten.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from ...solver.files import naming, replace
from ..fmu.operating_system import locked

HIDDEN = ".ballscrew"
KEPT = ".kept"
_STAGE, _NEXT, _WRITTEN = "next", "next.json", "written.json"

Files = dict[str, str]  # digests by path, relative to the folder


def write_run(folder: Path, write: Callable[[Path], None], adds: bool = False) -> list[str]:
    """Write the results of a run in place of those of the run before; return notes for the user.

    `write` puts all files into the folder that it is given. With `adds` they belong to the run
    whose results the folder holds. The notes say which of the user's files have another name now.
    OSError: something cannot be written; before the results are complete, nothing is changed.
    """
    hidden = _hidden(folder)
    hidden.mkdir(parents=True, exist_ok=True)
    stage, listed = hidden / _STAGE, hidden / (_NEXT + ".part")
    with locked(hidden):
        notes = _settle(folder)
        stage.mkdir()
        try:
            with naming(folder):
                write(stage)
                files = written_files(folder) if adds else {}
                for path in sorted(p for p in stage.rglob("*") if p.is_file()):
                    files[path.relative_to(stage).as_posix()] = _digest(path) or ""
                listed.write_text(json.dumps(files, indent=1), encoding="utf-8")
        except Exception:
            shutil.rmtree(stage, ignore_errors=True)
            raise
        replace(listed, hidden / _NEXT)
        return notes + _settle(folder)


def settle(folder: Path) -> list[str]:
    """Finish or undo the incomplete work of a killed process; notes and errors as `write_run`."""
    hidden = _hidden(folder)
    if not (hidden / _STAGE).exists() and not (hidden / _NEXT).exists():
        return []
    with locked(hidden):
        return _settle(folder)


def _hidden(folder: Path) -> Path:
    """The hidden folder; raises OSError if it is a link, behind which the user's files may be."""
    hidden = folder / HIDDEN
    if hidden.is_symlink():
        raise OSError(errno.ELOOP, "a link, expected a folder", str(hidden))
    return hidden


def written_files(folder: Path) -> Files:
    """The files that the last run wrote into a folder; none behind a link, if others made it."""
    listed = _listed(folder / HIDDEN / _WRITTEN)
    parents = {n: [folder / p for p in Path(n).parents if p.name] for n in listed}
    return {n: d for n, d in listed.items() if not any(p.is_symlink() for p in parents[n])}


def changed_since(folder: Path, instant: float) -> bool:
    """Whether a folder's run was written after an instant, as `time.time` counts."""
    listed = folder / HIDDEN / _WRITTEN
    return listed.is_file() and listed.stat().st_mtime >= instant


def _settle(folder: Path) -> list[str]:
    hidden = folder / HIDDEN
    stage = hidden / _STAGE
    moved: list[str] = []
    if (hidden / _NEXT).exists():
        files, before = _listed(hidden / _NEXT), written_files(folder)
        for name, digest in files.items():
            if not (stage / name).exists():
                continue  # in its place already
            moved += _make_way(folder, name, {before.get(name, digest), digest})
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            replace(stage / name, folder / name)
        for name in before.keys() - files.keys():
            if _digest(path := folder / name) == before[name]:
                path.unlink()
                with contextlib.suppress(OSError):  # the first folder that is not empty
                    os.removedirs(path.parent)
        replace(hidden / _NEXT, hidden / _WRITTEN)
    if stage.exists():
        shutil.rmtree(stage)
    said = f"{', '.join(moved)} in {folder}: not as ballscrew wrote it; kept, with {KEPT} after it"
    return [said] if moved else []


def _make_way(folder: Path, name: str, ours: set[str]) -> list[str]:
    """Rename foreign files that have the name of a result or of its folders."""
    moved = []
    for place in (*Path(name).parents, Path(name)):
        there = folder / place
        fits = _digest(there) in ours if place == Path(name) else there.is_dir()
        if os.path.lexists(there) and not fits:
            free = (there.with_name(f"{there.name}{KEPT}{k or ''}") for k in range(10**6))
            replace(there, next(p for p in free if not os.path.lexists(p)))
            moved.append(place.as_posix())
    return moved


def _digest(path: Path) -> str | None:
    """Digest of a file; None if it is no file."""
    if not path.is_file() or path.is_symlink():
        return None
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _listed(path: Path) -> Files:
    """A list of files; empty if there is none that we wrote."""
    try:
        files = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        files = None
    found = files.items() if isinstance(files, dict) else ()
    inside = ((n, d) for n, d in found if not n.startswith("/") and ".." not in Path(n).parts)
    return {n: digest for n, digest in inside if isinstance(digest, str)}
