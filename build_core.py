"""The build backend: that of setuptools, with the compiled core in the wheel.

The core is plain C without Python's headers, so that one wheel serves all versions of Python on a
platform. The system's compiler makes it, or ziglang where there is none. ziglang also makes wheels
for other platforms than this one, `PLATFORMS` in ``solver/compilers.py``::

    python -m build --wheel -C target=win64
"""

from __future__ import annotations

import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from sysconfig import get_platform
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  (what is not defined here is as it was)

TOP = Path(__file__).resolve().parent
LIBRARIES = {
    "solver/c/core.c": "libcore",
    "orchestration/master/c/master.c": "libmaster",
    "measurement/identification/c/identification.c": "libidentification",
}
CORE = next(iter(LIBRARIES))
# those of native FMUs; the package itself cannot be imported before it is built
COMPILERS = runpy.run_path(str(TOP / "solver" / "compilers.py"))
FLAGS, PLATFORMS = COMPILERS["FLAGS"], COMPILERS["PLATFORMS"]
ZIG = "ziglang>=0.13"

Settings = dict[str, Any] | None


def system_compiler() -> str:
    """The system's C compiler; empty if there is none."""
    return next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), "")


def target_of(settings: Settings) -> str:
    """The platform that ziglang compiles for; empty if the system's compiler does.

    Raises
    ------
    SystemExit
        If it is none of `PLATFORMS`.
    """
    asked = (settings or {}).get("target", "")
    if not asked and system_compiler():
        return ""
    target = asked or COMPILERS["this_platform"]()
    if target not in PLATFORMS:
        expected = f"expected one of {', '.join(PLATFORMS)}"
        if asked:
            raise SystemExit(f"target is {asked!r}, {expected}")
        raise SystemExit(f"no C compiler: looked for cc, gcc, clang, and this is no {expected}")
    return target


def get_requires_for_build_wheel(settings: Settings = None) -> list[str]:
    """What setuptools asks for, and ziglang where it compiles."""
    required = build_meta.get_requires_for_build_wheel(settings)
    return [*required, ZIG] if target_of(settings) else required


def build_wheel(folder: str, settings: Settings = None, metadata: str | None = None) -> str:
    """The wheel, for this platform or the one that the setting ``target`` names."""
    forget_other_builds()
    target = target_of(settings)
    tag = cross_compile_core(target) if target else compile_core()
    settings = {name: value for name, value in (settings or {}).items() if name != "target"}
    given = settings.get("--build-option", [])
    options = [given] if isinstance(given, str) else list(given)
    settings["--build-option"] = [*options, f"--plat-name={tag}"]
    return build_meta.build_wheel(folder, settings, metadata)


def forget_other_builds() -> None:
    """Remove the libraries of an earlier build, maybe for another platform."""
    shutil.rmtree(TOP / "build" / "lib", ignore_errors=True)
    for source in LIBRARIES:
        for library in (TOP / source).parent.glob("lib*"):
            library.unlink()


def compile_core() -> str:
    """Compile the libraries with the system's compiler; this platform, as a wheel names it."""
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    more = ["-lws2_32"] if sys.platform == "win32" else ["-fPIC", "-lm"]
    for source, name in LIBRARIES.items():
        made = (TOP / source).with_name(name + suffix)
        command = [system_compiler(), *FLAGS, "-o", str(made), str(TOP / source), *more]
        subprocess.run(command, check=True)
    return get_platform().replace("-", "_").replace(".", "_")


def cross_compile_core(target: str) -> str:
    """Compile the libraries with ziglang; the platform, as a wheel names it.

    With them goes the core for each other platform that readable FMUs run on, since those are
    carried there.
    """
    for source, name in LIBRARIES.items():
        cross_compile(source, target, name)
    for other, kind in PLATFORMS.items():
        if kind.readable and other != target:
            cross_compile(CORE, other, f"{LIBRARIES[CORE]}-{other}")
    return str(PLATFORMS[target].wheel)


def cross_compile(source: str, target: str, stem: str) -> None:
    """Compile one library; raises SystemExit without ziglang."""
    compiler = COMPILERS["cross_compiler"](target)
    if not compiler:
        raise SystemExit(f"{ZIG} is missing, which compiles for {target}; install it")
    given = [*FLAGS, str(TOP / source)]
    with tempfile.TemporaryDirectory() as folder:
        data = COMPILERS["compile_in"](Path(folder), target, given, stem, compiler)
    (TOP / source).with_name(stem + PLATFORMS[target].suffix).write_bytes(data)
