"""Kernels kept on disk, so that a second process neither derives nor prints equations again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from . import kernel_cache
from .files import write_atomically
from .kernel import Kernel

if TYPE_CHECKING:
    from .component import Component


@cache
def fingerprint() -> str:
    """Hash of everything that decides what is generated: our sources and SymPy's version."""
    top = Path(__file__).resolve().parent
    parts = [top, *(top.parent / name for name in ("plant", "controllers", "fmus"))]
    digest = hashlib.sha256(version("sympy").encode())
    for file in sorted(f for part in parts for f in part.glob("*.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def stored_kernel(name: str, make: Callable[[], Component]) -> Kernel:
    """The kernel of the component that `make` builds; `name` must determine what it builds.

    Parameters
    ----------
    name : str
        An identifier, unique among all callers.
    make : function without arguments
        Called only when the kernel is not on disk yet.
    """
    path = kernel_cache.folder() / "components" / f"{name}-{fingerprint()}.json"
    try:
        return Kernel.from_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError, KeyError):
        pass  # missing, or half a file from a full disk: make it
    from .codegen import generate

    kernel = generate(make())
    try:
        write_atomically(path, kernel.to_json().encode())
    except OSError:
        return kernel  # a read-only home costs time, not results
    return kernel
