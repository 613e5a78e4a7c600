"""Available memory, to reject requests that need more before they begin."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from pathlib import Path

from ...solver.errors import UserError
from .operating_system import address_space, free_memory

_CGROUPS = Path("/sys/fs/cgroup")


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Reject a request that would need so many bytes: what it is and the remedy become one line."""
    room = available_memory()
    if room is not None and needed > room:
        raise UserError(
            f"{what}, about {_shown(needed)} of memory, but only {_shown(room)} is available; "
            f"{remedy}"
        )


def available_memory() -> int | None:
    """Bytes that this process can still get; None if the system does not report it."""
    rooms = [*_of_the_machine(), *_of_the_cgroups(), *_of_the_process()]
    return max(0, min(rooms)) if rooms else None


def _shown(size: float) -> str:
    return f"{size / 1e9:.3g} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"


def _of_the_machine() -> Iterator[int]:
    if (available := _field(Path("/proc/meminfo"), "MemAvailable:")) is not None:
        yield 1024 * available
    if (free := free_memory()) is not None:
        yield free


def _of_the_cgroups() -> Iterator[int]:
    """Yield the bytes that each control group of this process leaves for it, parents included."""
    for line in _lines(Path("/proc/self/cgroup")):
        _, kinds, path = line.split(":", 2)
        top, names = _CGROUPS, ("memory.max", "memory.current", "inactive_file")
        if kinds:  # version 1
            top /= "memory"
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            if "memory" not in kinds.split(","):
                continue
        group = top / path.strip("/")
        for place in (group, *(p for p in group.parents if p.is_relative_to(top))):
            limit, used = (_number(place / name) for name in names[:2])
            if limit is not None and used is not None:
                # cached files are released when a group is short of memory
                yield limit - used + (_field(place / "memory.stat", names[2]) or 0)


def _of_the_process() -> Iterator[int]:
    limit, pages = address_space(), _lines(Path("/proc/self/statm"))
    if limit is not None and pages:
        yield limit - int(pages[0].split()[0]) * mmap.PAGESIZE


def _field(path: Path, name: str) -> int | None:
    """The number after a name; None if there is none."""
    fields = (line.split() for line in _lines(path))
    return next((int(f[1]) for f in fields if f[0] == name), None)


def _number(path: Path) -> int | None:
    """The number in a file; None if there is no file, or the word ``max``."""
    lines = _lines(path)
    return int(lines[0]) if lines and lines[0].isdigit() else None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []
