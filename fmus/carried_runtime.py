"""What of this package goes into every FMU that pythonfmu makes."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from ..solver.core import LIBRARY

RUNTIME = (
    "solver/core.py",
    "solver/stepper.py",
    "solver/plain_delays.py",
    f"solver/c/{LIBRARY}",
    "fmus/runtime.py",
    "fmus/process_end.py",
)
"""What of the package an FMU carries, in a package of its own whose name ends in its hash."""


@cache
def carried_runtime() -> tuple[str, dict[str, bytes]]:
    """Name and files of the package that an FMU carries."""
    top = Path(__file__).resolve().parents[1]
    files = {name: (top / name).read_bytes() for name in RUNTIME}
    digest = hashlib.sha256(
        b"\0".join(part for f in files.items() for part in (f[0].encode(), f[1]))
    )
    empty = {f"{folder}__init__.py": b"" for folder in ("", "solver/", "fmus/")}
    return f"ballscrew_{digest.hexdigest()[:12]}", files | empty
