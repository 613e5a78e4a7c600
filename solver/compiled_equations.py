"""Equations compiled by a C compiler for speed, kept on disk under a hash of their text.

A tape gives the same numbers about five times slower, and needs no compiler and no waiting.
Compiling takes half a second, which is worthwhile for long computations, such as a map.
"""

from __future__ import annotations

from importlib import resources

from . import kernel_cache
from .compilers import CompilerFailed, compile_library, compiler_for, own_platform
from .core import FUNCTIONS
from .tape import functions
from .translation import in_c

_TAIL = """
#ifdef _WIN32
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
void fill_system(System *s)
{
%s
}
"""


def compile_equations(module: str, source: str, states: int) -> bool:
    """Compile a generated text unless it is compiled already; return whether it is compiled.

    Parameters
    ----------
    module : str
        Its unique name.
    source : str
    states : int
    """
    path, platform = kernel_cache.compiled_path(module), own_platform()
    if kernel_cache.is_whole(path):
        return True
    if not platform or not compiler_for(platform):
        return False
    written = functions(source)
    names = [name for name in FUNCTIONS if name in written]
    parts = [in_c(written[name], states) for name in names]
    filled = "\n".join(f"    s->{name} = {name};" for name in names)
    head = resources.files(__package__).joinpath("c", "system.h").read_text(encoding="utf-8")
    text = "\n".join(['#include "system.h"\n', *parts, _TAIL % filled])
    try:
        data = compile_library(
            platform, {"system.h": head, "equations.c": text}, "equations.c", module
        )
        kernel_cache.write(path, data)
    except (CompilerFailed, OSError):
        return False  # slower, with the same numbers
    return True
