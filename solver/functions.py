"""The functions that an equation may contain, and their derivatives, defined also at kinks.

Both kinds of FMU support exactly the functions in `FUNCTIONS`. Derivatives are taken by
`slope` and `slopes`. At a kink the derivative is the mean of the derivatives on both sides; the
contribution of a jump or an infinite slope is zero. So no derivative is NaN or a delta
function where its equation has a value.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

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
    """The derivative of a supported expression by one symbol."""
    if by not in symbols_in(expression):
        return sp.Integer(0)
    return _replaced(_marked(expression).diff(by), _PLAIN)


@cache
def _marked(expression: sp.Expr) -> sp.Expr:
    """With functions whose derivatives are ours, if it has kinks."""
    kinked = any(isinstance(_power(*p.args), _Power) for p in expression.atoms(sp.Pow))
    kinked = kinked or not _kinds_in(expression).isdisjoint(_SPECIAL)
    return _replaced(expression, _MARKED) if kinked else expression


def _replaced(expression: sp.Expr, table: dict[type[sp.Basic], Any]) -> sp.Expr:
    for kind, function in table.items():
        if kind in _kinds_in(expression):
            expression = expression.replace(kind, function)
    return expression


@cache
def _kinds_in(expression: sp.Basic) -> frozenset[type]:
    return frozenset({type(expression)}).union(*map(_kinds_in, expression.args))


# -- functions whose derivatives are ours ---------------------------------------------------------


class _Marked(sp.Function):  # type: ignore[misc]
    """A SymPy function that is not evaluated and has its own derivatives."""

    is_extended_real = True

    @classmethod
    def eval(cls, *_arguments: sp.Expr) -> None:
        return None


class _Level(_Marked):
    """Constant except at jumps."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.Integer(0)


class _Sign(_Level):
    pass


class _Step(_Level):
    pass


class _Floor(_Level):
    pass


class _Ceiling(_Level):
    pass


class _Abs(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return _Sign(self.args[0])


class _Frac(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.Integer(1)


class _Mod(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        a, b = self.args
        return sp.Integer(1) if argindex == 1 else -_Floor(a / b)


class _Atan2(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        y, x = self.args
        square = x**2 + y**2
        nowhere = sp.Eq(square, 0)
        return (x if argindex == 1 else -y) / sp.Piecewise((1, nowhere), (square, True))


class _Max(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        shares = [sp.Piecewise((1, a >= self), (0, True)) for a in self.args]
        return shares[argindex - 1] / sp.Add(*shares)


class _Min(_Marked):
    def fdiff(self, argindex: int = 1) -> sp.Expr:
        shares = [sp.Piecewise((1, a <= self), (0, True)) for a in self.args]
        return shares[argindex - 1] / sp.Add(*shares)


class _Power(_Marked):
    """A power whose base may be zero."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        base, exponent = self.args
        zero = sp.Eq(base, 0)
        # a branch that is not chosen is still computed if it is shared
        other = sp.Piecewise((1, zero), (base, True))
        if argindex == 2:
            return sp.Piecewise((0, zero), (other**exponent * sp.log(other), True))
        if exponent.is_number and exponent > 1:
            return exponent * base ** (exponent - 1)
        at_zero = sp.Piecewise((1, sp.Eq(exponent, 1)), (0, True))
        return sp.Piecewise((at_zero, zero), (exponent * other ** (exponent - 1), True))


def _power(base: sp.Expr, exponent: sp.Expr) -> sp.Expr:
    never_zero = base.is_positive or base.is_number
    if exponent.is_integer or never_zero or (exponent.is_number and exponent < 0):
        return sp.Pow(base, exponent)
    return _Power(base, exponent)


_MARKED: dict[type[sp.Basic], Any] = {
    sp.sign: _Sign,
    sp.Heaviside: _Step,
    sp.ceiling: _Ceiling,
    sp.floor: _Floor,
    sp.Abs: _Abs,
    sp.frac: _Frac,
    sp.atan2: _Atan2,
    sp.Mod: _Mod,
    sp.Min: _Min,
    sp.Max: _Max,
    sp.Pow: _power,
}
_PLAIN: dict[type[sp.Basic], Any] = {_Power: sp.Pow}
_PLAIN |= {marked: plain for plain, marked in reversed(_MARKED.items()) if plain is not sp.Pow}
_SPECIAL = tuple(kind for kind in _MARKED if kind is not sp.Pow)
