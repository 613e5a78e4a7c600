"""Delayed signals as states at nodes along each delay, for tangents and Poincare sections.

A component with delays has infinitely many tangent directions. Here the history of a
signal within its delay is the polynomial through its values at Chebyshev nodes, which change
with time: the pseudospectral discretization (D. Breda et al., SIAM J. Appl. Dyn. Syst. 15, 1
(2016)). For signals without jumps the leading exponents converge faster than any power of
the number of nodes; the remaining exponents are artefacts of the nodes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from .component import Component, State, symbol
from .errors import ContractError

NODES = 16


def with_delay_states(component: Component, nodes: int = NODES) -> Component:
    """The same component without delays: the history of delayed signals is part of the states.

    Parameters
    ----------
    component : Component
        The new states are named after the delayed signals: ``<name>_1`` is the newest value
        and ``<name>_<nodes>`` the delayed signal itself.
    nodes : int
        Per delay. Exponents and frequencies up to about ``nodes / 4`` over the delay are accurate.

    Raises
    ------
    ContractError
        For discrete states, whose jumps a polynomial cannot represent.
    """
    if component.delays and component.discrete:
        raise ContractError(
            f"{component.name} has delays and is sampled; tangents of both together are not "
            "computed"
        )
    names = {d.name: [f"{d.name}_{k}" for k in range(1, nodes + 1)] for d in component.delays}
    fields = component.equations_with({symbol(n): symbol(own[-1]) for n, own in names.items()})
    slopes = _slopes(nodes)
    states = [
        State(
            name,
            delay.unit,
            f"{delay.name}, {k} of {nodes} nodes on its way",
            sp.Add(
                *(
                    weight * value
                    for weight, value in zip(
                        slopes[k],
                        [delay.expression, *map(symbol, names[delay.name])],
                        strict=True,
                    )
                )
            )
            / delay.duration,
            delay.start,
            delay.nominal,
        )
        for delay in fields["delays"]
        for k, name in enumerate(names[delay.name], start=1)
    ]
    fields["states"] = (*fields["states"], *states)
    return replace(component, **{**fields, "delays": ()})


def _slopes(nodes: int) -> list[list[sp.Float]]:
    """Minus the slopes, by the age over the delay, of polynomials through values at the nodes."""
    k = np.arange(nodes + 1)
    age = 0.5 * (1.0 - np.cos(np.pi * k / nodes))
    weights = (-1.0) ** k * np.where((k == 0) | (k == nodes), 0.5, 1.0)
    apart = age[:, None] - age[None, :] + np.eye(nodes + 1)
    slopes = weights[None, :] / weights[:, None] / apart
    np.fill_diagonal(slopes, 0.0)
    np.fill_diagonal(slopes, -slopes.sum(axis=1))
    return [[sp.Float(-v) for v in row] for row in slopes.tolist()]
