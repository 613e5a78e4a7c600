"""The generated equations, which are plain Python over ``math``, as C, and compiled for speed.

Writing them in C term by term keeps the order of every operation, so that they give the numbers of
the tapes, about five times as fast, and no new derivation is needed. Compiling takes half a second,
which is worthwhile for long computations, such as a map; the library is kept on disk.
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
from .errors import ContractError
from .tape import CONSTANTS, OF_ONE, OF_TWO, functions

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
_OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "&&",
    ast.Or: "||",
    ast.USub: "-",
    ast.UAdd: "+",
    ast.Not: "!",
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


def in_c(function: ast.FunctionDef, width: int, name: str = "") -> str:
    """One generated function in C.

    Parameters
    ----------
    function : ast.FunctionDef
    width : int
        Columns of matrices.
    name : str, optional
        Name in C, if different.

    Raises
    ------
    ContractError
        If it contains something for which C has no function.
    """
    head = _HEADS[function.name]
    if name:
        head = head.replace(f" {function.name}(", f" {name}(")
    lines = [f"static {head}", "{"]
    lines += [f"    (void)({a});" for a in ("self", *(a.arg for a in function.args.args))]
    body = "\n".join(_block(function.body, width, "    "))
    calls = Counter(re.findall(r"\b(\w+)\(", body))
    for called in sorted(set(OF_ONE).difference(_CHEAP, _OTHER_NAME)):
        if calls[called] > 1:
            lines.append(f"    Known known_{called} = {{NAN, NAN}};")
            body = re.sub(rf"\b{called}\(", f"known({called}, &known_{called}, ", body)
    return "\n".join([*lines, body, "}"]) + "\n"


def expression_in_c(text: str) -> str:
    """One generated expression in C."""
    return _expression(ast.parse(text, mode="eval").body, 1)


def _block(statements: list[ast.stmt], width: int, indent: str) -> list[str]:
    lines: list[str] = []
    for s in statements:
        if isinstance(s, ast.Assign):
            (target,) = s.targets
            left = _expression(target, width)
            declared = f"const {_type(s.value)} " if isinstance(target, ast.Name) else ""
            lines.append(f"{indent}{declared}{left} = {_expression(s.value, width)};")
        elif isinstance(s, ast.If):
            lines.append(f"{indent}if ({_expression(s.test, width)}) {{")
            lines += _block(s.body, width, indent + "    ")
            if s.orelse:
                lines.append(f"{indent}}} else {{")
                lines += _block(s.orelse, width, indent + "    ")
            lines.append(f"{indent}}}")
        elif isinstance(s, ast.Return):
            value = f" {_expression(s.value, width)}" if s.value else ""
            # kinds of events are whole numbers
            lines.append(f"{indent}return{value.removesuffix('.0')};")
        elif not isinstance(s, ast.Pass):
            raise _untranslated(s)
    return lines


def _type(value: ast.expr) -> str:
    logical = isinstance(value, ast.Compare | ast.BoolOp) or (
        isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
    )
    return "int" if logical else "double"


def _expression(e: ast.expr, width: int) -> str:
    def inner(part: ast.expr) -> str:
        return _expression(part, width)

    if isinstance(e, ast.Constant) and isinstance(e.value, bool):
        return str(int(e.value))
    if isinstance(e, ast.Constant) and isinstance(e.value, int | float):
        return _number(e.value)
    if isinstance(e, ast.Name):
        return e.id
    if isinstance(e, ast.Subscript):
        at = e.slice
        if isinstance(at, ast.Tuple):
            row, column = (int(ast.literal_eval(part)) for part in at.elts)
            return f"{inner(e.value)}[{row * width + column}]"
        return f"{inner(e.value)}[{inner(at)}]"
    if isinstance(e, ast.BinOp) and isinstance(e.op, ast.Pow):
        return f"pow({inner(e.left)}, {inner(e.right)})"
    if isinstance(e, ast.BinOp) and isinstance(e.op, ast.Mod):
        return f"modulo({inner(e.left)}, {inner(e.right)})"
    if isinstance(e, ast.BinOp) and type(e.op) in _OPERATORS:
        return f"({inner(e.left)} {_OPERATORS[type(e.op)]} {inner(e.right)})"
    if isinstance(e, ast.UnaryOp) and type(e.op) in _OPERATORS:
        return f"({_OPERATORS[type(e.op)]}{inner(e.operand)})"
    if isinstance(e, ast.BoolOp):
        return "(" + f" {_OPERATORS[type(e.op)]} ".join(map(inner, e.values)) + ")"
    if isinstance(e, ast.Compare) and all(type(o) in _OPERATORS for o in e.ops):
        parts = [e.left, *e.comparators]
        pairs = [
            f"({inner(a)} {_OPERATORS[type(o)]} {inner(b)})"
            for a, o, b in zip(parts, e.ops, parts[1:], strict=False)
        ]
        return pairs[0] if len(pairs) == 1 else f"({' && '.join(pairs)})"
    if isinstance(e, ast.IfExp):
        return f"({inner(e.test)} ? {inner(e.body)} : {inner(e.orelse)})"
    if isinstance(e, ast.Attribute) and ast.unparse(e.value) == "math" and e.attr in CONSTANTS:
        return _number(CONSTANTS[e.attr])
    if isinstance(e, ast.Call) and not e.keywords:
        return _call(e, list(map(inner, e.args)))
    raise _untranslated(e)


def _number(value: float) -> str:
    return repr(value) if math.isfinite(value) else "HUGE_VAL"


def _call(e: ast.Call, arguments: list[str]) -> str:
    called = ast.unparse(e.func)
    if called == "abs":
        return f"fabs({arguments[0]})"
    if called in ("min", "max") and arguments:
        text = arguments[0]
        for other in arguments[1:]:
            text = f"{'larger' if called == 'max' else 'smaller'}({text}, {other})"
        return text
    name = called.removeprefix("math.") if called.startswith("math.") else ""
    if name in OF_ONE or name in OF_TWO:
        return f"{_OTHER_NAME.get(name, name)}({', '.join(arguments)})"
    raise _untranslated(e)


def _untranslated(node: ast.AST) -> ContractError:
    return ContractError(
        f"{ast.unparse(node)!r} in its equations has no counterpart in C; export it without "
        "--native"
    )
