"""What each unknown depends on, read off the generated equations, for the model description."""

from __future__ import annotations

import ast
from collections import defaultdict
from dataclasses import dataclass

from ...solver.kernel import Kernel
from ...solver.tape import functions
from ..interface import Variable
from .partials import Entry
from .sources import NativeModel

TIME = "t"


@dataclass(frozen=True)
class Dependency:
    """One state, input or time (None) that an unknown depends on, in any mode.

    Attributes
    ----------
    known : Variable or None
    kind : {"constant", "fixed", "dependent"}
        Whether the slope is a number, an expression of parameters, or neither.
    """

    known: Variable | None
    kind: str


@dataclass(frozen=True)
class Dependencies:
    """Lists in the order of value references, time last.

    Attributes
    ----------
    derivatives, outputs, indicators : list of list of Dependency
        One list per state, output and event indicator.
    """

    derivatives: list[list[Dependency]]
    outputs: list[list[Dependency]]
    indicators: list[list[Dependency]]


def dependencies_of(model: NativeModel) -> Dependencies:
    """What derivatives, outputs and event indicators depend on."""
    kernel = model.kernel
    states, inputs = len(kernel.states), len(kernel.inputs)
    columns: dict[str, tuple[int, Variable]] = {
        f"x[{k}]": (k, v) for k, v in enumerate(model.state_variables)
    }
    by_place = {v.place: v for v in model.interface.variables if v.causality == "input"}
    for k in range(inputs):
        if k in by_place:
            columns[f"u[{k}]"] = (states + k, by_place[k])
    kinds = _kinds(model)

    def listed(used: set[str], row: int | None) -> list[Dependency]:
        found = []
        for symbol in used & columns.keys():
            column, known = columns[symbol]
            kind = "dependent" if row is None else kinds.get(Entry(row, column), "dependent")
            found.append(Dependency(known, kind))
        found.sort(key=lambda d: d.known.reference if d.known else 0)
        return found + [Dependency(None, "dependent")] * (TIME in used)

    rhs, out, indicate = (_uses(kernel, name) for name in ("rhs", "out", "indicate"))
    return Dependencies(
        [listed(rhs[k], k) for k in range(states)],
        [listed(out[k], states + k) for k in range(len(kernel.outputs))],
        [listed(indicate[k], None) for k in range(model.events)],
    )


def _kinds(model: NativeModel) -> dict[Entry, str]:
    """Of each partial derivative that is not zero everywhere; those of modes may differ."""
    if model.kernel.modes:
        return {}
    uses = _uses(model.partials, "out")
    found = {}
    for k, entry in enumerate(model.entries):
        parameters = all(symbol.startswith("p[") for symbol in uses[k])
        found[entry] = ("fixed" if uses[k] else "constant") if parameters else "dependent"
    return found


def _uses(kernel: Kernel, name: str) -> defaultdict[int, set[str]]:
    """Symbols as ``x[0]``, ``u[2]``, ``p[1]`` or ``t`` by the number of the result, in any mode."""
    found: defaultdict[int, set[str]] = defaultdict(set)

    def symbols(value: ast.expr, known: dict[str, set[str]]) -> set[str]:
        used: set[str] = set()
        for node in ast.walk(value):
            if isinstance(node, ast.Subscript):
                used.add(ast.unparse(node))
            elif isinstance(node, ast.Name):
                used |= known.get(node.id, {TIME} if node.id == TIME else set())
        return used

    def read(body: list[ast.stmt], known: dict[str, set[str]]) -> None:
        for s in body:
            if isinstance(s, ast.If):  # modes reuse names
                read(s.body, dict(known))
                read(s.orelse, dict(known))
            elif isinstance(s, ast.Assign):
                (target,) = s.targets
                if isinstance(target, ast.Name):
                    known[target.id] = symbols(s.value, known)
                elif isinstance(target, ast.Subscript):
                    found[int(ast.literal_eval(target.slice))] |= symbols(s.value, known)

    read(functions(kernel.source)[name].body, {})
    return found
