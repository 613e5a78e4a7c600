"""The functions that an equation may contain, and their derivatives, defined also at kinks.

Both kinds of FMU support exactly the functions in `FUNCTIONS`. Derivatives are taken by
`slope` and `slopes`. At a kink the derivative is the mean of the derivatives on both sides; the
contribution of a jump or an infinite slope is zero. So no derivative is NaN or a delta
function where its equation has a value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import sympy as sp
from sympy.core.numbers import ComplexInfinity, ImaginaryUnit, NaN
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanFalse, BooleanTrue


def symbol(name: str) -> sp.Symbol:
    """The real symbol of this name, in the form that every component uses."""
    return sp.Symbol(name, real=True)


TIME = symbol("t")

FUNCTIONS: dict[type[sp.Basic], str] = {
    **dict.fromkeys((sp.exp, sp.log, sp.erf, sp.erfc), ""),
    **dict.fromkeys((sp.sin, sp.cos, sp.tan, sp.cot, sp.sec, sp.csc), ""),
    **dict.fromkeys((sp.asin, sp.acos, sp.atan), ""),
    **dict.fromkeys((sp.sinh, sp.cosh, sp.tanh, sp.coth, sp.sech, sp.csch), ""),
    **dict.fromkeys((sp.asinh, sp.acosh, sp.atanh), ""),
    sp.atan2: "at (0, 0): value 0, derivatives 0",
    sp.Abs: "at 0: derivative 0",
    sp.sign: "at 0: value 0; derivative 0 everywhere",
    sp.Heaviside: "at 0: value 1/2, or the second argument; derivative 0 everywhere",
    sp.Max: "where two arguments are the largest: the mean of their derivatives",
    sp.Min: "where two arguments are the smallest: the mean of their derivatives",
    sp.floor: "at a jump: the value above it; derivative 0 everywhere",
    sp.ceiling: "at a jump: the value below it; derivative 0 everywhere",
    sp.Mod: "at a jump: value 0; derivative 1 by the first argument, -floor(a/b) by the second",
    sp.frac: "at a jump: value 0; derivative 1 everywhere",
    sp.Piecewise: "at a border: value and derivative of the piece that holds there",
    sp.Pow: "at base 0: derivative 0 where the exponent is between 0 and 1, as of sqrt",
}
"""Functions by class, and their value and derivative at a kink or a jump.

Sums, products, comparisons, `And`, `Or`, `Not`, numbers and symbols are also supported.
"""

_PARTS = (
    *(sp.Symbol, sp.Number, sp.NumberSymbol, sp.Add, sp.Mul, sp.core.relational.Relational),
    *(sp.And, sp.Or, sp.Not, BooleanTrue, BooleanFalse, ExprCondPair),
    sp.ITE,  # SymPy's form of a Piecewise within a condition
    *FUNCTIONS,
)


@cache
def unsupported_function(node: sp.Basic) -> str:
    """Name of the first function in it that is not supported; empty if there is none."""
    if isinstance(node, ImaginaryUnit | NaN | ComplexInfinity) or not isinstance(node, _PARTS):
        return str(node.func.__name__)
    if isinstance(node, sp.Piecewise) and node.args[-1].cond != sp.true:
        return "Piecewise without a last piece (..., True)"
    return next(filter(None, map(unsupported_function, node.args)), "")


@cache
def symbols_in(expression: sp.Basic) -> frozenset[sp.Symbol]:
    """The symbols of an expression; shared parts are searched once."""
    if isinstance(expression, sp.Symbol):
        return frozenset({expression})
    return frozenset().union(*map(symbols_in, expression.args))


def slopes(expressions: Sequence[sp.Expr], by: Sequence[sp.Symbol]) -> sp.Matrix:
    """The partial derivatives of supported expressions, one row each, one column per symbol."""
    entries = [slope(sp.sympify(e), symbol) for e in expressions for symbol in by]
    return sp.Matrix(len(expressions), len(by), entries)


@cache
def slope(expression: sp.Expr, by: sp.Symbol) -> sp.Expr:
    """The derivative of a supported expression by one symbol.

    Except at kinks it is that of SymPy's ``diff``, which repeats its checks for every part.
    """
    if by not in symbols_in(expression):
        return sp.Integer(0)
    if expression == by:
        return sp.Integer(1)
    args = expression.args
    if isinstance(expression, sp.Piecewise):
        return sp.Piecewise(*((slope(e, by), condition) for e, condition in args))
    inner = [(k, slope(a, by)) for k, a in enumerate(args) if by in symbols_in(a)]
    if isinstance(expression, sp.Add):
        return sp.Add(*(s for _, s in inner))
    if isinstance(expression, sp.Mul):
        return sp.Add(*(sp.Mul(*args[:k], s, *args[k + 1 :]) for k, s in inner))
    if isinstance(expression, sp.Pow) and not _may_have_a_kink(*args):
        base, exponent = args
        by_exponent = slope(exponent, by) * sp.log(base)
        return expression * (by_exponent + slope(base, by) * exponent / base)
    outer = _OUTER.get(type(expression), _of_smooth)
    return sp.Add(*(outer(expression, k) * s for k, s in inner))


# -- functions whose derivatives are ours: by one argument, given its place ------------------------


def _of_smooth(e: sp.Expr, k: int) -> sp.Expr:
    return e.fdiff(k + 1)


def _of_atan2(e: sp.Expr, k: int) -> sp.Expr:
    y, x = e.args
    square = x**2 + y**2
    nowhere = sp.Eq(square, 0)
    return (-y if k else x) / sp.Piecewise((1, nowhere), (square, True))


def _of_largest(e: sp.Expr, k: int) -> sp.Expr:
    compared = [a >= e if isinstance(e, sp.Max) else a <= e for a in e.args]
    shares = [sp.Piecewise((1, here), (0, True)) for here in compared]
    return shares[k] / sp.Add(*shares)


def _may_have_a_kink(base: sp.Expr, exponent: sp.Expr) -> bool:
    """Whether the base of a power may be zero where the power has a value."""
    if exponent.is_integer or (exponent.is_number and exponent < 0):
        return False
    return not (base.is_number or base.is_positive)


def _of_power(e: sp.Expr, k: int) -> sp.Expr:
    base, exponent = e.args
    zero = sp.Eq(base, 0)
    # a branch that is not chosen is still computed if it is shared
    other = sp.Piecewise((1, zero), (base, True))
    if k == 1:
        return sp.Piecewise((0, zero), (other**exponent * sp.log(other), True))
    if exponent.is_number and exponent > 1:
        return exponent * base ** (exponent - 1)
    at_zero = sp.Piecewise((1, sp.Eq(exponent, 1)), (0, True))
    return sp.Piecewise((at_zero, zero), (exponent * other ** (exponent - 1), True))


_OUTER: dict[type[sp.Basic], Callable[[sp.Expr, int], sp.Expr]] = {
    **dict.fromkeys((sp.sign, sp.Heaviside, sp.floor, sp.ceiling), lambda _e, _k: sp.Integer(0)),
    **dict.fromkeys((sp.Max, sp.Min), _of_largest),
    sp.Abs: lambda e, _: sp.sign(e.args[0]),
    sp.frac: lambda _e, _k: sp.Integer(1),
    sp.Mod: lambda e, k: -sp.floor(e.args[0] / e.args[1]) if k else sp.Integer(1),
    sp.atan2: _of_atan2,
    sp.Pow: _of_power,
}
