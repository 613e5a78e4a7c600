"""FMUs of the catalogue for runs of this program: native ones if there is a compiler."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

from ... import solver
from ...solver import kernel_cache
from ...solver.compilers import CompilerFailed, compiler_for, own_platform
from ...solver.stored import fingerprint
from ..catalogue import fmu, fmu_kernel
from ..made_here import is_kept, keep
from .export import write_native
from .sources import catalogued_model

NATIVE, READABLE = "native", "readable"


@dataclass(frozen=True)
class ReadyFmu:
    """An FMU in the user's cache; `build` is `NATIVE` or `READABLE`."""

    path: Path
    build: str


def ready_fmu(name: str, tangents: int = 0) -> ReadyFmu:
    """The FMU of this name in the user's cache; made if it does not exist yet.

    Parameters
    ----------
    name : str
        Of the catalogue.
    tangents : int
        Number of tangents; 0 for the ordinary FMU.

    Raises
    ------
    UnknownComponent
    UnsupportedComponent
        If it cannot have tangents.
    """
    try:
        return ReadyFmu(_native(name, tangents), NATIVE)
    except CompilerFailed:
        return ReadyFmu(fmu(name, tangents=tangents), READABLE)


def _native(name: str, tangents: int) -> Path:
    """Raises CompilerFailed also if there is no compiler."""
    kernel = fmu_kernel(name, tangents=tangents)
    content = kernel.to_json() + _way_of_making()
    stem = kernel_cache.hashed_name(f"{kernel.name}_native", content)
    path = kernel_cache.entry(kernel_cache.FMUS, f"{stem}.fmu")
    if is_kept(path):
        return path
    platform = own_platform()
    if not platform or not compiler_for(platform):
        raise CompilerFailed("there is no C compiler")
    model = catalogued_model(name, tangents=tangents)
    return keep(path, lambda: write_native(model, path, 2, [platform]))


@cache
def _way_of_making() -> str:
    """Hash of everything except the equations that affects the FMU: Python and C sources."""
    digest = hashlib.sha256(fingerprint("ballscrew.fmus.native.export").encode())
    for folder in (resources.files(__package__) / "c", resources.files(solver) / "c"):
        for file in sorted(folder.iterdir(), key=lambda f: f.name):
            if file.name.endswith((".c", ".h")):
                digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
