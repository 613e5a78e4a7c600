"""Find a C compiler for a platform, and make a shared library with it."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s")
_LONGEST = 900.0  # seconds; the first time for a platform, ziglang compiles its C library


class CompilerFailed(RuntimeError):
    """A compiler that is there does not compile; the message holds its own words in one block."""


@dataclass(frozen=True)
class Platform:
    """One kind of machine.

    Attributes
    ----------
    folder : dict of int to str
        Name of its folder in ``binaries``, by version of FMI.
    target : str
        What ziglang calls it; of Linux with the oldest C library that it can ask for.
    """

    folder: dict[int, str]
    target: str
    suffix: str
    system: str
    flags: tuple[str, ...]


PLATFORMS = {
    "linux64": Platform(
        {2: "linux64", 3: "x86_64-linux"},
        "x86_64-linux-gnu.2.17",
        ".so",
        "Linux",
        ("-fPIC", "-lm"),
    ),
    "win64": Platform(
        {2: "win64", 3: "x86_64-windows"}, "x86_64-windows-gnu", ".dll", "Windows", ()
    ),
    "darwin64": Platform(
        {2: "darwin64", 3: "x86_64-darwin"}, "x86_64-macos", ".dylib", "Darwin", ("-fPIC",)
    ),
}


def own_platform() -> str:
    """Name of the platform this runs on; empty if it is none of `PLATFORMS`."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return ""
    return next((n for n, p in PLATFORMS.items() if p.system == platform.system()), "")


def compiler_for(name: str) -> list[str]:
    """The command that compiles for a platform: the system's compiler or ziglang; empty if none."""
    if name == own_platform():
        for command in ("cc", "gcc", "clang"):
            if shutil.which(command):
                return [command]
    if importlib.util.find_spec("ziglang"):
        # its sanitizer would bring in a library of its own
        target = ["-target", PLATFORMS[name].target, "-fno-sanitize=undefined"]
        return [sys.executable, "-m", "ziglang", "cc", *target]
    return []


def compile_library(name: str, sources: Mapping[str, str], main: str, stem: str) -> bytes:
    """The shared library for a platform.

    Parameters
    ----------
    name : str
        One of `PLATFORMS`; `compiler_for` must have found a compiler for it.
    sources : mapping of str to str
        Text by file name.
    main : str
        The file among them to compile.
    stem : str
        Name of the library without its suffix.

    Raises
    ------
    CompilerFailed
    """
    from .files import temporary_folder  # not at the top: the build of this package runs this file

    with temporary_folder("compile") as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(text, encoding="utf-8", newline="\n")
        return compile_in(Path(folder), name, [*FLAGS, main], stem)


def compile_in(folder: Path, name: str, arguments: Sequence[str], stem: str) -> bytes:
    """The shared library for a platform, of files that lie in a folder, where it is made, too.

    Parameters
    ----------
    folder : Path
    name : str
        As in `compile_library`.
    arguments : sequence of str
        Flags and sources, as the compiler is run in that folder.
    stem : str
        As in `compile_library`.

    Raises
    ------
    CompilerFailed
    """
    made_for = PLATFORMS[name]
    compiler = compiler_for(name)
    target = folder / f"{stem}{made_for.suffix}"
    command = [*compiler, *arguments, "-o", target.name, *made_for.flags]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_LONGEST,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompilerFailed(f"{compiler[0]} cannot be run for {name}: {error}") from error
    if done.returncode or not target.is_file():
        said = (done.stderr.strip() or done.stdout.strip())[:4000] or "nothing"
        raise CompilerFailed(
            f"{' '.join(compiler)} does not compile {stem} for {name} and says:\n{said}"
        )
    return target.read_bytes()
