"""Find a C compiler for a platform, and make a shared library with it."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s")
_LONGEST = 900.0  # seconds; the first time for a platform, ziglang compiles its C library


class CompilerFailed(RuntimeError):
    """A compiler was found but it fails; the message contains the compiler's own output."""


@dataclass(frozen=True)
class Platform:
    """One kind of machine."""

    folder: dict[int, str]  # name of its folder in ``binaries``, by version of FMI
    target: str  # its name in ziglang; for Linux with the oldest C library that ziglang supports
    suffix: str
    system: str  # as in Python's `platform`
    machines: tuple[str, ...]  # the same, in lower case
    wheel: str  # platform tag of its wheel
    flags: tuple[str, ...]  # of the compiler
    # whether FMUs of pythonfmu run there; they carry the core for each such platform
    readable: bool


_MACHINES = {"x86_64": ("x86_64", "amd64"), "aarch64": ("aarch64", "arm64")}
# FMI 2.0 has names of folders for x86-64 only
_OLD = {"linux": "linux64", "windows": "win64", "darwin": "darwin64"}
# of each system: suffix, target, flags, and tags of its wheels by machine
_WHEELS = "manylinux_2_17_x86_64 manylinux_2_17_aarch64", "macosx_11_0_x86_64 macosx_11_0_arm64"
_SYSTEMS = {
    "linux": (".so", "linux-gnu.2.17", ("-fPIC", "-lm"), _WHEELS[0].split()),
    "windows": (".dll", "windows-gnu", ("-lws2_32",), ["win_amd64", "win_arm64"]),
    "darwin": (".dylib", "macos.11.0", ("-fPIC",), _WHEELS[1].split()),
}


def _platforms() -> Iterator[Platform]:
    for k, (machine, machines) in enumerate(_MACHINES.items()):
        for system, (suffix, target, flags, wheels) in _SYSTEMS.items():
            old = {2: _OLD[system]} if machine == "x86_64" else {}
            yield Platform(
                {**old, 3: f"{machine}-{system}"},
                f"{machine}-{target}",
                *(suffix, system.capitalize(), machines, wheels[k], flags),
                readable=bool(old) and system != "darwin",
            )


PLATFORMS = {p.folder.get(2, p.folder[3]): p for p in _platforms()}


def platforms_of(fmi: int) -> tuple[str, ...]:
    """Names of the platforms that native FMUs of a version of FMI can hold binaries for."""
    return tuple(name for name, kind in PLATFORMS.items() if fmi in kind.folder)


def this_platform() -> str:
    """Name of this platform; empty if it is not in `PLATFORMS`."""
    here = platform.system(), platform.machine().lower()
    kinds = PLATFORMS.items()
    return next((n for n, p in kinds if p.system == here[0] and here[1] in p.machines), "")


def own_platform() -> str:
    """Name of this platform in FMI 2.0; empty if it has none."""
    return name if (name := this_platform()) in platforms_of(2) else ""


def compiler_for(name: str) -> list[str]:
    """The command that compiles for a platform: the system's compiler or ziglang; empty if none."""
    if name == own_platform():
        for command in ("cc", "gcc", "clang"):
            if shutil.which(command):
                return [command]
    return cross_compiler(name)


def cross_compiler(name: str) -> list[str]:
    """The command of ziglang that compiles for a platform from any other; empty without it."""
    if not importlib.util.find_spec("ziglang"):
        return []
    # its sanitizer would add a library
    target = ["-target", PLATFORMS[name].target, "-fno-sanitize=undefined"]
    return [sys.executable, "-m", "ziglang", "cc", *target]


def compile_library(name: str, texts: Mapping[str, str], given: Sequence[str], stem: str) -> bytes:
    """The library made from texts by file name, with `FLAGS` and `given`; see `compile_in`."""
    from .files import temporary_folder  # not at the top: the build of this package runs this file

    with temporary_folder("compile") as folder:
        for file, text in texts.items():
            (Path(folder) / file).write_text(text, encoding="utf-8", newline="\n")
        return compile_in(Path(folder), name, [*FLAGS, *given], stem)


def compile_in(
    folder: Path,
    name: str,
    arguments: Sequence[str],
    stem: str,
    compiler: Sequence[str] | None = None,
) -> bytes:
    """The shared library for one of `PLATFORMS`, made from the files of a folder, in that folder.

    `arguments` are flags and sources, `stem` is its name without suffix; `compiler` is the command,
    by default the one that `compiler_for` finds. Raises CompilerFailed.
    """
    made_for = PLATFORMS[name]
    compiler = compiler_for(name) if compiler is None else compiler
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
