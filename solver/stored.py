"""Kernels kept on disk, so that a second process does not derive and print equations again.

A kernel is kept under a hash of the sources that its equations come from: the modules that make the
component, and all modules of this package that those import.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from . import kernel_cache
from .kernel import Kernel

if TYPE_CHECKING:
    from .component import Component

_TOP = Path(__file__).parents[1]
_GENERATOR = "ballscrew.solver.codegen"
_FROM = re.compile(r"^[ \t]*from[ \t]+(\.*)([\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.M)
_NAMED = re.compile(r'"(ballscrew(?:\.\w+)+):\w+"')  # "module:function", as in the lists of parts


@cache
def sources_of(module: str) -> dict[str, Path]:
    """Files of a module of this package and of all modules that it imports, or they import."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name in found or file is None:
            continue
        found[name] = file
        waiting += _imported(name, file)
    return found


def _file_of(module: str) -> Path | None:
    """None if this is not a module but a name within one; nothing is imported."""
    stem = _TOP.joinpath(*module.split(".")[1:])
    files = stem.with_name(stem.name + ".py"), stem / "__init__.py"
    return next((f for f in files if f.is_file()), None)


def _imported(module: str, file: Path) -> Iterator[str]:
    text = file.read_text(encoding="utf-8")
    package = module.split(".") if file.name == "__init__.py" else module.split(".")[:-1]
    for dots, name, imported in _FROM.findall(text):
        start = package[: len(package) + 1 - len(dots)] if dots else []
        parent = ".".join([*start, *([name] if name else [])])
        if parent.startswith("ballscrew."):  # the package itself has no equations
            yield parent
        if parent.partition(".")[0] == "ballscrew":
            yield from (f"{parent}.{n}" for n in re.findall(r"\w+", imported) if n.islower())
    yield from _NAMED.findall(text)


@cache
def fingerprint(*modules: str) -> str:
    """Hash of all that affects the generated text: these modules, and SymPy's version."""
    sources = {n: f for m in (_GENERATOR, *modules) for n, f in sources_of(m).items()}
    digest = hashlib.sha256(version("sympy").encode())
    for name in sorted(sources):
        digest.update(name.encode() + b"\0" + sources[name].read_bytes())
    return digest.hexdigest()[:16]


def stored_kernel(name: str, make: Callable[[], Component], *modules: str) -> Kernel:
    """The kernel of the component that `make` builds, which is called only if it is not on disk.

    `name` is an identifier that is unique among all callers; the component's equations come from
    these modules of this package.
    """
    path = kernel_cache.entry(kernel_cache.COMPONENTS, f"{name}-{fingerprint(*modules)}.json")

    def derived() -> bytes:
        from .codegen import generate

        return generate(make()).to_json().encode()

    return Kernel.from_json(kernel_cache.kept(path, derived).decode())
