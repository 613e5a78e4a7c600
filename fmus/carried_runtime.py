"""Files of this package that are part of every FMU made by pythonfmu."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from ..solver import compilers, kernel_cache
from ..solver.compilers import FLAGS, PLATFORMS
from ..solver.core import LIBRARY
from ..solver.files import temporary_folder

RUNTIME = (
    *("solver/errors.py", "solver/core.py", "solver/tape.py"),
    *("fmus/runtime.py", "fmus/process_end.py"),
)
"""The files that an FMU contains, as a separate package whose name ends in its hash;
with the compiled core for each available platform."""
_TOP = Path(__file__).resolve().parents[1]
_C = _TOP / "solver" / "c"


def carried_runtime(everywhere: bool = False) -> tuple[str, dict[str, bytes]]:
    """Name and files of the package that an FMU contains.

    Parameters
    ----------
    everywhere : bool
        With the core for each platform on which an FMU of pythonfmu runs: from this package, or
        compiled by ziglang. Otherwise with the cores of this package.
    """
    held = platforms_with_core()[0] if everywhere else ()
    return _package(tuple(n for n in held if n not in _in_package()))


@cache
def _package(others: tuple[str, ...]) -> tuple[str, dict[str, bytes]]:
    files = {name: (_TOP / name).read_bytes() for name in RUNTIME}
    files |= {f"solver/c/{p.name}": p.read_bytes() for p in sorted(_C.glob("libcore*"))}
    for name in others:
        files[f"solver/c/libcore-{name}{PLATFORMS[name].suffix}"] = _cross_compiled(name) or b""
    digest = hashlib.sha256(
        b"\0".join(part for f in files.items() for part in (f[0].encode(), f[1]))
    )
    empty = {f"{folder}__init__.py": b"" for folder in ("", "solver/", "fmus/")}
    return f"ballscrew_{digest.hexdigest()[:12]}", files | empty


def platforms_with_core() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The platforms for which `carried_runtime` has the core everywhere, and those it lacks."""
    held = [n for n in _readable() if n in _in_package() or _cross_compiled(n)]
    return tuple(held), tuple(n for n in _readable() if n not in held)


def _readable() -> list[str]:
    """Platforms on which FMUs of pythonfmu run."""
    return [name for name, kind in PLATFORMS.items() if kind.readable]


def _in_package() -> list[str]:
    """Those of them for which this package has the core."""
    own = compilers.own_platform() if (_C / LIBRARY).is_file() else ""
    return [
        n for n in _readable() if n == own or (_C / f"libcore-{n}{PLATFORMS[n].suffix}").is_file()
    ]


def _cross_compiled(name: str) -> bytes | None:
    """The core for another platform, compiled once for the same sources; None if that fails."""
    if not (compiler := compilers.cross_compiler(name)):
        return None
    digest = hashlib.sha256(repr((name, PLATFORMS[name], FLAGS)).encode())
    for source in sorted(_C.glob("*.[ch]")):
        digest.update(source.read_bytes())
    made = kernel_cache.entry(kernel_cache.COMPILED, digest.hexdigest())
    arguments = [*FLAGS, str(_C / "core.c")]

    def make() -> bytes:
        with temporary_folder("compile") as folder:
            return compilers.compile_in(Path(folder), name, arguments, "libcore", compiler)

    try:
        return kernel_cache.kept(made, make)
    except compilers.CompilerFailed:  # such as for a user without a home folder
        return None
