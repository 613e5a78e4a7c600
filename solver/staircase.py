"""Quantizers: the staircase as it is, and what it is on average over where its steps lie."""

from __future__ import annotations

import sympy as sp

from .component import Component


def dithered_average(component: Component) -> Component:
    """The component with each staircase replaced by its mean over all places of its steps.

    The mean of ``floor(e + d)`` over a dither d that is spread evenly over one step, from -1/2 to
    1/2, is ``e - 1/2``; of ``ceiling(e + d)`` it is ``e + 1/2`` (e.g. B. Widrow and I. Kollar,
    Quantization Noise, Cambridge 2008). A staircase itself has no derivative that says anything
    about stability: it is zero, but for jumps.
    """
    half = sp.Rational(1, 2)
    table = {
        stair: stair.replace(sp.floor, lambda e: e - half).replace(sp.ceiling, lambda e: e + half)
        for _, expression in component.expressions()
        for stair in sp.sympify(expression).atoms(sp.floor, sp.ceiling)
    }
    return component.substituted(table) if table else component
