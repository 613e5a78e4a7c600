"""Compile an FMU that has sources and no binary for this platform."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path, PurePosixPath
from typing import Any

from ..solver import kernel_cache
from ..solver.compilers import CompilerFailed, compile_in, compiler_for, own_platform

_STANDARDS = {"C89": "gnu90", "C90": "gnu90", "C99": "gnu99"}
_STANDARDS |= {"C11": "gnu11", "C17": "gnu17", "C18": "gnu17"}
# functions have the names of FMI, without prefix
_NAMES = tuple(f"-DFMI{version}_OVERRIDE_FUNCTION_PREFIX" for version in (2, 3))
_FLAGS = ("-O2", "-shared", "-ffp-contract=off", *_NAMES)


class NotCompiled(RuntimeError):
    """The sources cannot be compiled to a library here; the message says why, in one line."""


def compile_sources(folder: Path, configuration: Any, binary: str) -> None:
    """Put the library where the FMU expects it; compiled once for the same sources.

    Parameters
    ----------
    folder : Path
        Of the unpacked FMU.
    configuration : fmpy's BuildConfiguration
    binary : str
        Path of the library in that folder.

    Raises
    ------
    NotCompiled
    """
    name = own_platform()
    compiler = compiler_for(name) if name else []
    if not compiler:
        raise NotCompiled("no C compiler was found; install one, or the package ziglang")
    identifier = str(configuration.modelIdentifier)
    try:
        arguments = _arguments(folder, configuration)
        (folder / binary).parent.mkdir(parents=True, exist_ok=True)
        made = _library(folder, name, arguments, compiler, identifier)
        (folder / binary).write_bytes(made)
    except CompilerFailed as error:
        lines = str(error).splitlines()
        said = next((line for line in lines if "error" in line), lines[-1])
        raise NotCompiled(f"the sources do not compile: {said.strip()[:300]}") from error
    except OSError as error:
        raise NotCompiled(f"the library cannot be written: {error}") from error


def _library(
    folder: Path, name: str, arguments: list[str], compiler: list[str], identifier: str
) -> bytes:
    """The library, compiled once for the same sources."""
    digest = hashlib.sha256(repr((compiler, arguments, identifier)).encode())
    for file in sorted(p for p in (folder / "sources").rglob("*") if p.is_file()):
        digest.update(str(file.relative_to(folder)).encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())

    def make() -> bytes:
        library = compile_in(folder, name, arguments, "compiled", compiler)
        if names := _with_prefix(library, identifier):
            named = [f"-D{identifier}_{plain}={plain}" for plain in names]
            library = compile_in(folder, name, [*arguments, *named], "compiled", compiler)
        return library

    made = kernel_cache.entry(kernel_cache.COMPILED, digest.hexdigest())
    return kernel_cache.kept(made, make)


def _with_prefix(library: bytes, identifier: str) -> list[str]:
    """FMI functions that a library exports only with the model's name as prefix.

    The headers of FMI 2.0 to 2.0.1 cannot switch off a prefix that sources define; macros can.
    """
    found = re.findall(rb"\0(?:%s_)(fmi[23][A-Z]\w+)(?=\0)" % identifier.encode(), library)
    names = dict.fromkeys(name.decode() for name in found)
    return [n for n in names if b"\0" + n.encode() + b"\0" not in library]


def _arguments(folder: Path, configuration: Any) -> list[str]:
    """Flags and sources."""
    import fmpy

    flags: dict[str, None] = {}
    sources = []
    for files in configuration.sourceFileSets:
        language = files.language or "C99"
        if language not in _STANDARDS:
            raise NotCompiled(f"they are in {language}, expected C")
        flags[f"-std={_STANDARDS[language]}"] = None
        for d in files.preprocessorDefinitions:
            if not d.optional:
                flags[f"-D{d.name}" + (f"={d.value}" if d.value is not None else "")] = None
        places = (_inside(place) for place in ("", *filter(None, files.includeDirectories)))
        flags |= {f"-I{place}": None for place in places}
        sources += [_inside(file or "") for file in files.sourceFiles]
    for source in sources:
        if not (folder / source).is_file():
            raise NotCompiled(f"{source} is not there")
    # headers of FMI, if the FMU does not contain them
    headers = Path(fmpy.__file__).parent / "c-code"
    return [*_FLAGS, *flags, f"-I{headers}", *sources]


def _inside(name: str) -> str:
    place = PurePosixPath("sources", *PurePosixPath(name.replace("\\", "/")).parts)
    if place.is_absolute() or ".." in place.parts:
        raise NotCompiled(f"{name!r} is outside their folder")
    return f"./{place}"
