"""The build backend: that of setuptools, with the compiled core in the wheel.

The core is plain C without Python's headers, so that one wheel serves all versions of Python on a
platform. The system's compiler makes it, or ziglang where there is none.
"""

from __future__ import annotations

import importlib.util
import platform
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  (what is not defined here is as it was)

TOP = Path(__file__).resolve().parent
LIBRARIES = {
    "solver/c/core.c": "libcore",
    "orchestration/c/master.c": "libmaster",
    "identification/c/identification.c": "libidentification",
}
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
# those of native FMUs; the package itself cannot be imported before it is built
FLAGS = runpy.run_path(str(TOP / "solver" / "compilers.py"))["FLAGS"]
ZIG = "ziglang>=0.13"

Settings = dict[str, Any] | None


def system_compiler() -> str:
    """The system's C compiler; empty if there is none."""
    return next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), "")


def get_requires_for_build_wheel(settings: Settings = None) -> list[str]:
    """What setuptools asks for, and a compiler where there is none."""
    required = build_meta.get_requires_for_build_wheel(settings)
    return required if system_compiler() else [*required, ZIG]


def build_wheel(folder: str, settings: Settings = None, metadata: str | None = None) -> str:
    """The wheel, for this platform."""
    tag = compile_core()
    settings = dict(settings or {})
    given = settings.get("--build-option", [])
    options = [given] if isinstance(given, str) else list(given)
    settings["--build-option"] = [*options, f"--plat-name={tag}"]
    return build_meta.build_wheel(folder, settings, metadata)


def compile_core() -> str:
    """Compile the libraries into their folders; the platform they are for, as a wheel names it."""
    machine = platform.machine()
    compiler, more, tag = [system_compiler()], [], f"linux_{machine}"
    if not compiler[0]:
        if not importlib.util.find_spec("ziglang"):
            raise SystemExit(
                f"no C compiler: looked for cc, gcc, clang and {ZIG}; install one of them"
            )
        compiler = [sys.executable, "-m", "ziglang", "cc"]
        if sys.platform == "linux":
            more, tag = ["-target", f"{machine}-linux-gnu.2.17"], f"manylinux_2_17_{machine}"
    if sys.platform != "win32":
        more += ["-fPIC", "-lm"]
    if sys.platform != "linux":
        from sysconfig import get_platform

        tag = get_platform().replace("-", "_").replace(".", "_")
    for source, name in LIBRARIES.items():
        made = (TOP / source).with_name(name + SUFFIX)
        command = [*compiler, *FLAGS, "-o", str(made), str(TOP / source), *more]
        subprocess.run(command, check=True)
    return tag
