"""The generated equations, which are plain Python over ``math``, as C, and compiled for speed.

Writing them in C term by term keeps the order of every operation, so that they give the numbers of
the tapes, about five times as fast. Compiling takes half a second, which is worthwhile for a map.
"""

from __future__ import annotations

import ast
import math
import re
from collections import Counter
from importlib import resources

from . import kernel_cache
from .compilers import CompilerFailed, compile_library, compiler_for, own_platform
from .core import FUNCTIONS
from .tape import OF_ONE, Recorder, functions

_GIVEN = "const System *self, double t, const double *x, const double *u, const double *p"
_HEADS = {
    "rhs": f"void rhs({_GIVEN}, double *dx)",
    "jac": f"void jac({_GIVEN}, double *J, double *ft)",
    "out": f"void out({_GIVEN}, double *y)",
    "sample": f"void sample({_GIVEN}, double *d)",
    "indicate": f"void indicate({_GIVEN}, double *g)",
    "spread": f"void spread({_GIVEN}, double *s)",
    "kind": "int kind(const System *self, const double *u, int k)",
    "react": "void react(const System *self, double t, double *x, double *u, const double *p, "
    "int k)",
    "delayed": f"void delayed({_GIVEN}, double *e)",
    "slopes": f"double slopes({_GIVEN}, int k, double *g, double *R, double *rt)",
}
_CHEAP = ("ceil", "fabs", "floor", "sqrt")
_OTHER_NAME = {"gamma": "tgamma"}
_CALLED = {"POWER": "pow", "MODULO": "modulo", "LARGER": "larger", "SMALLER": "smaller"}
_SIGNS = "+ - * / < <= == != && ||".split()
_SIGNED = "ADD SUBTRACT MULTIPLY DIVIDE LESS LESS_EQUAL EQUAL NOT_EQUAL AND OR".split()
_OPERATIONS = {
    **{name: f"({{}} {sign} {{}})" for name, sign in zip(_SIGNED, _SIGNS, strict=True)},
    **{name: f"{called}({{}}, {{}})" for name, called in _CALLED.items()},
    "NEGATE": "(-{})",
    "NOT": "(!{})",
    "SELECT": "({2} ? {0} : {1})",
}
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
    """Compile the text of a module unless it is compiled already; return whether it is compiled."""
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
        files = {"system.h": head, "equations.c": text}
        kernel_cache.write(path, compile_library(platform, files, ["equations.c"], module))
    except (CompilerFailed, OSError):
        return False  # slower, with the same numbers
    return True


class _Writer(Recorder):
    """Writes lines of C; a number is its text."""

    indent = "    "

    def constant(self, value: float) -> str:
        if isinstance(value, bool):
            return str(int(value))
        return repr(value) if math.isfinite(value) else "HUGE_VAL"

    def emit(self, operation: str, *operands: str) -> str:
        return _OPERATIONS[operation].format(*operands)

    def call(self, name: str, arguments: list[str]) -> str:
        return f"{_OTHER_NAME.get(name, name)}({', '.join(arguments)})"

    def load(self, vector: str, index: int) -> str:
        return f"{vector}[{index}]"

    def store(self, vector: str, index: int, value: str) -> None:
        self.line(f"{vector}[{index}] = {value};")

    def named(self, name: str, value: str) -> str:
        self.line(f"const double {name} = {value};")
        return name

    def branch(self, test: str, yes: list[ast.stmt], no: list[ast.stmt]) -> None:
        outside = self.indent
        self.line(f"if ({test}) {{")
        self.indent += "    "
        self.block(yes)
        if no:
            self.lines.append(f"{outside}}} else {{")
            self.block(no)
        self.indent = outside
        self.line("}")

    def truth(self, e: ast.expr) -> str:
        return str(self.value(e))

    def end(self, value: str | None) -> None:
        self.line(f"return {value};" if value else "return;")

    def line(self, text: str) -> None:
        self.lines.append(self.indent + text)


def in_c(function: ast.FunctionDef, width: int, name: str = "") -> str:
    """One generated function in C, with matrices of `width` columns; `name`: in C, if different."""
    head = _HEADS[function.name]
    if name:
        head = head.replace(f" {function.name}(", f" {name}(")
    lines = [f"static {head}", "{"]
    lines += [f"    (void)({a});" for a in ("self", *(a.arg for a in function.args.args))]
    writer = _Writer(width, {"t": "t", "k": "k"})
    writer.block(function.body)
    body = "\n".join(writer.lines)
    calls = Counter(re.findall(r"\b(\w+)\(", body))
    for called in sorted(set(OF_ONE).difference(_CHEAP, _OTHER_NAME)):
        if calls[called] > 1:
            lines.append(f"    Known known_{called} = {{NAN, NAN}};")
            body = re.sub(rf"\b{called}\(", f"known({called}, &known_{called}, ", body)
    return "\n".join([*lines, body, "}"]) + "\n"


def expression_in_c(text: str) -> str:
    """One generated expression in C."""
    expression = ast.parse(text, mode="eval").body
    names = {e.id: e.id for e in ast.walk(expression) if isinstance(e, ast.Name)}
    return str(_Writer(1, names).value(expression))
