"""Inputs of the results of generated equations, from their text."""

from __future__ import annotations

import ast
import hashlib
import re
from collections import defaultdict
from dataclasses import dataclass, field

from ..solver.kernel import Kernel
from ..solver.tape import functions
from .interface import START, TIME


@dataclass
class Uses:
    """Symbols and expressions of one result, such as ``y[0]``, in all modes together.

    Attributes
    ----------
    symbols : set of str
        As ``x[0]``, ``u[2]``, ``p[1]`` or ``t``.
    texts : set of str
        Its expressions, shortened; two of them mean that modes may differ.
    """

    symbols: set[str] = field(default_factory=set)
    texts: set[str] = field(default_factory=set)


def uses_of(kernel: Kernel, name: str) -> defaultdict[str, Uses]:
    """Symbols that each result of a function of the generated text uses."""
    found: defaultdict[str, Uses] = defaultdict(Uses)

    def read(body: list[ast.stmt], known: dict[str, tuple[set[str], str]]) -> None:
        for s in body:
            if isinstance(s, ast.If):  # modes reuse names
                read(s.body, dict(known))
                read(s.orelse, dict(known))
            elif isinstance(s, ast.Assign):
                (target,) = s.targets
                if isinstance(target, ast.Name):
                    known[target.id] = _read(s.value, known)
                elif isinstance(target, ast.Subscript):
                    symbols, text = _read(s.value, known)
                    result = found[ast.unparse(target)]
                    result.symbols |= symbols
                    result.texts.add(text)

    read(functions(kernel.source)[name].body, {})
    return found


def _read(value: ast.expr, known: dict[str, tuple[set[str], str]]) -> tuple[set[str], str]:
    used: set[str] = set()
    for node in ast.walk(value):
        if isinstance(node, ast.Subscript):
            used.add(ast.unparse(node))
        elif isinstance(node, ast.Name) and node.id in known:
            used |= known[node.id][0]
        elif isinstance(node, ast.Name) and node.id == TIME:
            used.add(TIME)
    text = re.sub(r"\w+", lambda m: known[m[0]][1] if m[0] in known else m[0], ast.unparse(value))
    return used, text if len(text) < 80 else hashlib.sha256(text.encode()).hexdigest()


def initial_uses(kernel: Kernel, name: str) -> list[set[str]]:
    """Names of the inputs, parameters and start values that results depend on in initialization.

    Parameters
    ----------
    kernel : Kernel
    name : {"rhs", "out", "states"}
        Of which results: derivatives, outputs, states.

    Returns
    -------
    list of set of str
        Per result; the time, which is no variable of FMI 2, as ``t``.
    """
    choice, resets = _first_mode(kernel)
    if name == "states":
        states = range(len(kernel.states))
        found = [Uses({f"x[{k}]"}, {""}) for k in states]
    else:
        results = uses_of(kernel, name)
        vector, count = ("dx", kernel.states) if name == "rhs" else ("y", kernel.outputs)
        found = [results[f"{vector}[{k}]"] for k in range(len(count))]
    names = _names(kernel)
    listed = []
    for result in found:
        symbols = result.symbols | (choice if len(result.texts) > 1 else set())
        followed: set[str] = set()
        while more := symbols - followed:
            followed |= more
            symbols |= set().union(*(resets[s] for s in more if s in resets))
        listed.append({names[s] for s in symbols if s in names})
    return listed


def _first_mode(kernel: Kernel) -> tuple[set[str], dict[str, set[str]]]:
    """Symbols that determine the first mode, and the states that are reset before it."""
    if not kernel.modes:
        return set(), {}
    choice: set[str] = set().union(*(u.symbols for u in uses_of(kernel, "indicate").values()))
    reset = uses_of(kernel, "react").items()
    return choice, {state: choice | uses.symbols for state, uses in reset}


def _names(kernel: Kernel) -> dict[str, str]:
    """Variables of symbols, except those of delayed signals, which have start values."""
    inputs = len(kernel.inputs)
    return {
        TIME: TIME,
        **{f"x[{k}]": s.name + START for k, s in enumerate(kernel.states)},
        **{f"u[{k}]": i.name for k, i in enumerate(kernel.inputs) if i.role != "internal"},
        **{f"u[{inputs + k}]": d.name + START for k, d in enumerate(kernel.discrete)},
        **{f"p[{k}]": p.name for k, p in enumerate(kernel.parameters)},
    }
