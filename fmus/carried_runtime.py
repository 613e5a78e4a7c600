"""Files of this package that are part of every FMU made by pythonfmu."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

RUNTIME = (
    "solver/core.py",
    "solver/stepper.py",
    "solver/plain_delays.py",
    "fmus/runtime.py",
    "fmus/process_end.py",
)
"""The files that an FMU contains, as a separate package whose name ends in its hash;
with the compiled core for each available platform."""


@cache
def carried_runtime() -> tuple[str, dict[str, bytes]]:
    """Name and files of the package that an FMU contains."""
    top = Path(__file__).resolve().parents[1]
    cores = sorted(f"solver/c/{p.name}" for p in (top / "solver" / "c").glob("libcore*"))
    files = {name: (top / name).read_bytes() for name in (*RUNTIME, *cores)}
    digest = hashlib.sha256(
        b"\0".join(part for f in files.items() for part in (f[0].encode(), f[1]))
    )
    empty = {f"{folder}__init__.py": b"" for folder in ("", "solver/", "fmus/")}
    return f"ballscrew_{digest.hexdigest()[:12]}", files | empty
