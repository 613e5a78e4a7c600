"""The range of an instrument."""

from __future__ import annotations

import sympy as sp


def saturate(value: sp.Expr, limit: sp.Expr) -> sp.Expr:
    """A value limited to both signs of a limit."""
    return sp.Max(-limit, sp.Min(limit, value))
