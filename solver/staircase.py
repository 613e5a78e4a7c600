"""Quantizers: the staircase, and its mean over the positions of its steps."""

from __future__ import annotations

import sympy as sp

from .component import Component, symbol
from .functions import symbols_in


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
