"""What the unknowns of a model description depend on, from the text of the generated equations.

Variables are given by their value references.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..solver.kernel import Kernel
from ..solver.tape import functions

if TYPE_CHECKING:
    from .interface import Interface

TIME = "t"  # its name in equations
Kinds = Mapping[tuple[int, int], str]
"""Kinds of slopes that are not zero everywhere, ``constant``, ``fixed`` or ``dependent``, by their
row and column, see `native.partials`."""


@dataclass
class Uses:
    """Symbols and expressions of one result, such as ``y[0]``, in all modes together."""

    symbols: set[str] = field(default_factory=set)  # as x[0], u[2], p[1] or t
    texts: set[str] = field(default_factory=set)  # shortened; two of them: modes may differ


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
    text = ast.unparse(value)
    for word in re.findall(r"\w+\[\d+\]|\w+", text):
        if word in known:
            used |= known[word][0]
        elif word == TIME or word.endswith("]"):
            used.add(word)
    text = re.sub(r"\w+", lambda m: known[m[0]][1] if m[0] in known else m[0], text)
    return used, text if len(text) < 80 else hashlib.sha256(text.encode()).hexdigest()


def states_of_outputs(kernel: Kernel) -> list[int]:
    """Number of the state that each output is equal to, in every mode; -1 if there is none."""
    texts = {f"x[{k}]": k for k in range(len(kernel.states))}
    uses = uses_of(kernel, "out")
    found = [uses[f"y[{k}]"].texts for k in range(len(kernel.outputs))]
    return [texts.get(next(iter(own)), -1) if len(own) == 1 else -1 for own in found]


def kinds_of(partials: Kernel, entries: list[tuple[int, int]]) -> Kinds:
    """Kinds of the slopes that are the outputs of a component; modes may differ."""
    if partials.modes:
        return {}
    uses = uses_of(partials, "out")
    found = {}
    for k, entry in enumerate(entries):
        used = uses[f"y[{k}]"].symbols
        parameters = all(symbol.startswith("p[") for symbol in used)
        found[entry] = ("fixed" if used else "constant") if parameters else "dependent"
    return found


Knowns = list[dict[int, str]]
"""Knowns of each unknown, with the kind of the slope, in the order of value references."""


def dependencies_of(
    kernel: Kernel, interface: Interface, kinds: Kinds
) -> tuple[Knowns, Knowns, Knowns]:
    """States, inputs and time that outputs, derivatives and indicators depend on, in any mode."""
    states, outputs = len(kernel.states), len(kernel.outputs)
    columns = {f"x[{k}]": (k, v.reference) for k, v in enumerate(interface.states)}
    for v in interface.of("input"):
        columns[f"u[{v.place}]"] = states + v.place, v.reference

    def listed(function: str, vector: str, count: int, first: int) -> Knowns:
        uses, rows = uses_of(kernel, function), []
        for k in range(count):
            used = uses[f"{vector}[{k}]"].symbols
            own = [columns[symbol] for symbol in used & columns.keys()]
            row = {at: kinds.get((first + k, column), "dependent") for column, at in own}
            if TIME in used:
                row[interface.time_reference] = "dependent"
            rows.append(dict(sorted(row.items())))
        return rows

    return (
        listed("out", "y", outputs, states),
        listed("rhs", "dx", len(interface.derivatives), 0),
        listed("indicate", "g", interface.events, states + outputs),
    )


def initial_dependencies_of(kernel: Kernel, interface: Interface) -> list[tuple[int, list[int]]]:
    """Inputs, parameters and start values that each unknown depends on in initialization.

    Outputs come first, then states that are no outputs, then derivatives.
    """
    choice, resets = _first_mode(kernel)
    known = _known(kernel, interface)

    def listed(result: Uses) -> list[int]:
        symbols = result.symbols | (choice if len(result.texts) > 1 else set())
        followed: set[str] = set()
        while more := symbols - followed:
            followed |= more
            symbols |= set().union(*(resets[s] for s in more if s in resets))
        return sorted(known[s] for s in symbols if s in known)

    out, rhs = uses_of(kernel, "out"), uses_of(kernel, "rhs")
    unknowns = [(v, out[f"y[{k}]"]) for k, v in enumerate(interface.of("output"))]
    states = ((v, Uses({f"x[{k}]"}, {""})) for k, v in enumerate(interface.states))
    unknowns += [(v, uses) for v, uses in states if v.causality == "local"]
    unknowns += [(v, rhs[f"dx[{k}]"]) for k, v in enumerate(interface.derivatives)]
    return [(v.reference, listed(uses)) for v, uses in unknowns]


def _first_mode(kernel: Kernel) -> tuple[set[str], dict[str, set[str]]]:
    """Symbols that determine the first mode, and the states that are reset before it."""
    if not kernel.modes:
        return set(), {}
    choice: set[str] = set().union(*(u.symbols for u in uses_of(kernel, "indicate").values()))
    reset = uses_of(kernel, "react").items()
    return choice, {state: choice | uses.symbols for state, uses in reset}


def _known(kernel: Kernel, interface: Interface) -> dict[str, int]:
    """Variables of symbols, except those of delayed signals, which have start values."""
    at, states = interface.layout, len(kernel.states)
    places = {f"x[{k}]": at.starts + k for k in range(states)}
    places |= {f"u[{k}]": k for k in range(at.inputs)}
    places |= {f"u[{at.inputs + k}]": at.starts + states + k for k in range(at.discrete)}
    places |= {f"p[{k}]": at.parameters + k for k in range(len(kernel.parameters))}
    settable = (*interface.of("input"), *interface.of("parameter"))
    references = {v.place: v.reference for v in settable}
    known = {s: references[place] for s, place in places.items() if place in references}
    return known | {TIME: interface.time_reference}
