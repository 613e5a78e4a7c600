"""Components in the form that tangents and Poincare sections need.

Discrete states are among the states, the past of a delayed signal is a polynomial in further
states, and a quantizer is replaced by its mean.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from .component import Component, Event, Mode, State, symbol
from .errors import ContractError
from .functions import symbols_in

NODES = 16
_NEVER = sp.Integer(-1)  # an indicator that is never positive: only the clock triggers it


def with_held_states(component: Component) -> Component:
    """The same component with its discrete states among the states.

    Their derivatives are zero, and their update is the first event of every mode;
    `follow_tangents` and `follow_returns` trigger it at the multiples of the sample time.

    Parameters
    ----------
    component : Component
        With discrete states; the new states have the same names.
    """
    held = tuple(
        State(d.name, d.unit, d.meaning, sp.Integer(0), d.start, d.nominal)
        for d in component.discrete
    )
    sample = Event("sample", _NEVER, 1, {d.name: d.update for d in component.discrete})
    modes = component.modes or (Mode("sampled"),)
    return replace(
        component,
        states=(*component.states, *held),
        discrete=(),
        modes=tuple(replace(m, events=(sample, *m.events)) for m in modes),
    )


def with_delay_states(component: Component, nodes: int = NODES) -> Component:
    """The same component without delays: the history of delayed signals is part of the states.

    The history of a signal within its delay is the polynomial through its values at Chebyshev
    nodes, which change with time: the pseudospectral discretization (D. Breda et al., SIAM J. Appl.
    Dyn. Syst. 15, 1 (2016)). For signals without jumps the leading exponents converge faster than
    any power of the number of nodes; the remaining exponents are artefacts of the nodes.

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
            sp.Add(*map(sp.Mul, slopes[k], [delay.expression, *map(symbol, names[delay.name])]))
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


def dithered_average(component: Component) -> Component:
    """The component with each staircase replaced by its mean over all positions of its steps.

    The mean of ``floor(e + d)`` over a dither d that is spread evenly over one step, from -1/2 to
    1/2, is ``e - 1/2``; of ``ceiling(e + d)`` it is ``e + 1/2`` (e.g. B. Widrow and I. Kollar,
    Quantization Noise, Cambridge 2008). The derivative of a staircase itself gives no
    information about stability: it is zero except at jumps.

    Staircases of parameters, or of whole numbers as in a noise generator,
    are not changed.
    """
    whole, given = _whole_states(component), {symbol(p.name) for p in component.all_parameters}
    half = sp.Rational(1, 2)
    table = {
        stair: stair.replace(sp.floor, lambda e: e - half).replace(sp.ceiling, lambda e: e + half)
        for _, expression in component.expressions()
        for stair in sp.sympify(expression).atoms(sp.floor, sp.ceiling)
        if not (symbols_in(stair) <= given or _is_whole(stair.args[0], whole))
    }
    return component.substituted(table) if table else component


def _whole_states(component: Component) -> set[sp.Symbol]:
    """The discrete states that are whole numbers from their start on."""
    updates = {symbol(d.name): sp.sympify(d.update) for d in component.discrete}
    whole = {symbol(d.name) for d in component.discrete if float(d.start).is_integer()}
    while left := {s for s in whole if not _is_whole(updates[s], whole)}:
        whole -= left
    return whole


def _is_whole(expression: sp.Expr, whole: set[sp.Symbol]) -> bool:
    """Whether an expression is a whole number if these symbols are."""
    if isinstance(expression, sp.floor | sp.ceiling):
        return True
    if isinstance(expression, sp.Piecewise):
        return all(_is_whole(pair.expr, whole) for pair in expression.args)
    if isinstance(expression, sp.Add | sp.Mul | sp.Mod):
        return all(_is_whole(part, whole) for part in expression.args)
    return bool(expression.is_integer) or expression in whole
