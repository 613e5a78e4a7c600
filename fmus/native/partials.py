"""The partial derivatives of a component's derivatives and outputs by its states and inputs.

Directional and adjoint derivatives are sums of them. They use the same code
generator as everything else: they are the only outputs of a component.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import sympy as sp

from ...solver.component import Component, Mode, Output, symbol
from ...solver.functions import slopes

_NAME = "partial_{}_{}"


def entry_of(name: str) -> tuple[int, int]:
    """Row and column of the output of this name, for a component made by `partials`.

    Rows are those of the derivatives, then of the outputs; columns of the states, then of inputs.
    """
    _, row, column = name.rsplit("_", 2)
    return int(row), int(column)


def partials(component: Component) -> Component:
    """A component whose outputs are the partial derivatives that are not zero everywhere.

    Parameters
    ----------
    component : Component
        With the feedback law's ports.
    """
    modes: Sequence[Mode | None] = component.modes or (None,)
    columns = [symbol(s.name) for s in component.all_states]
    columns += [symbol(i.name) for i in component.inputs]
    by_mode = [_matrix(component, mode, columns) for mode in modes]
    rows, width = by_mode[0].shape
    outputs: list[Output] = []
    moded: list[dict[str, sp.Expr]] = [{} for _ in modes]
    for row in range(rows):
        for column in range(width):
            values = [matrix[row, column] for matrix in by_mode]
            if all(v == 0 for v in values):
                continue
            name = _NAME.format(row, column)
            outputs.append(Output(name, "1", name, values[0]))
            for own, value in zip(moded, values, strict=True):
                own[name] = value
    return Component(
        f"{component.name}_partials",
        f"partial derivatives of {component.name}",
        parameters=tuple(p for p in component.all_parameters if p != component.sample_time),
        inputs=component.inputs,
        states=tuple(replace(s, derivative=sp.Integer(0)) for s in component.all_states),
        outputs=tuple(outputs),
        discrete=tuple(replace(d, update=sp.Integer(0)) for d in component.discrete),
        sample_time=component.sample_time,
        delays=component.delays,
        modes=tuple(
            Mode(m.name, outputs=own) for m, own in zip(component.modes, moded, strict=False)
        ),
    )


def _matrix(component: Component, mode: Mode | None, columns: Sequence[sp.Symbol]) -> sp.Matrix:
    rows = [
        (mode.derivatives if mode else {}).get(s.name, e)
        for s, e in zip(component.all_states, component.derivatives, strict=True)
    ]
    rows += [(mode.outputs if mode else {}).get(o.name, o.value) for o in component.all_outputs]
    return slopes(rows, columns)
