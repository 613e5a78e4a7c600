"""Dependencies of each unknown, from the generated equations, for the model description."""

from __future__ import annotations

from dataclasses import dataclass

from ..interface import TIME, Variable
from ..uses import uses_of
from .partials import Entry
from .sources import NativeModel


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
    """Dependencies of derivatives, outputs and event indicators."""
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

    rhs, out, indicate = (uses_of(kernel, name) for name in ("rhs", "out", "indicate"))
    return Dependencies(
        [listed(rhs[f"dx[{k}]"].symbols, k) for k in range(states)],
        [listed(out[f"y[{k}]"].symbols, states + k) for k in range(len(kernel.outputs))],
        [listed(indicate[f"g[{k}]"].symbols, None) for k in range(model.events)],
    )


def _kinds(model: NativeModel) -> dict[Entry, str]:
    """Kind of each partial derivative that is not zero everywhere; modes may differ."""
    if model.kernel.modes:
        return {}
    uses = uses_of(model.partials, "out")
    found = {}
    for k, entry in enumerate(model.entries):
        used = uses[f"y[{k}]"].symbols
        parameters = all(symbol.startswith("p[") for symbol in used)
        found[entry] = ("fixed" if used else "constant") if parameters else "dependent"
    return found
