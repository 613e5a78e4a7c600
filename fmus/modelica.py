"""A component as readable Modelica: the equations, for users who want to change them.

Names, units, start values and outputs are those of the FMU. Modes, samples and
delays are not supported: events and synchronous clocks of Modelica differ from ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import BooleanFunction
from sympy.printing.str import StrPrinter

from ..solver.component import TIME, Component, symbol
from ..solver.errors import ContractError
from .interface import START

_WIDTH = 100  # of a line
_REWRITTEN = {
    **{sp.asinh: sp.log, sp.acosh: sp.log, sp.atanh: sp.log},
    **{sp.sech: sp.cosh, sp.csch: sp.sinh, sp.coth: sp.tanh},
    **{sp.sec: sp.cos, sp.csc: sp.sin, sp.cot: sp.tan},
}
_RESERVED = frozenset(
    "algorithm and annotation block break class connect connector constant constrainedby der "
    "discrete each else elseif elsewhen encapsulated end enumeration equation expandable extends "
    "external false final flow for function if import impure in initial inner input loop model not "
    "operator or outer output package parameter partial protected public pure record redeclare "
    "replaceable return stream then time true type when while within".split()
)


class _Printer(StrPrinter):  # type: ignore[misc]
    """Expressions in Modelica syntax."""

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:
        del rational
        base, exponent = expr.args
        if exponent == sp.S.Half:
            return f"sqrt({self._print(base)})"
        if exponent.is_Number and exponent.is_negative:
            below = base if exponent == -1 else sp.Pow(base, -exponent, evaluate=False)
            return f"1/{self.parenthesize(below, 70, strict=False)}"
        return f"{self._atom(base)}^{self._atom(exponent)}"

    def _atom(self, expr: sp.Expr) -> str:
        text = str(self._print(expr))
        number = expr.is_Number and expr.is_nonnegative and "/" not in text
        return text if number or expr.is_Symbol or expr == sp.pi else f"({text})"

    def _print_Float(self, expr: sp.Float) -> str:
        return repr(float(expr))

    def _print_Pi(self, expr: Any) -> str:
        return "pi"

    def _print_Exp1(self, expr: Any) -> str:
        return "exp(1)"

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return "time" if expr == TIME else str(expr.name)

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *pieces, last = expr.args
        words = [f"if {self._print(c)} then {self._print(e)}" for e, c in pieces]
        return f"({' else'.join(words)} else {self._print(last[0])})"

    def _print_ITE(self, expr: sp.ITE) -> str:
        return "(if {} then {} else {})".format(*map(self._print, expr.args))

    def _print_And(self, expr: sp.And) -> str:
        return " and ".join(f"({self._print(a)})" for a in expr.args)

    def _print_Or(self, expr: sp.Or) -> str:
        return " or ".join(f"({self._print(a)})" for a in expr.args)

    def _print_Not(self, expr: sp.Not) -> str:
        return f"not ({self._print(expr.args[0])})"

    def _print_BooleanTrue(self, expr: Any) -> str:
        return "true"

    def _print_BooleanFalse(self, expr: Any) -> str:
        return "false"

    def _print_Heaviside(self, expr: sp.Heaviside) -> str:
        x, middle = (self._print(a) for a in expr.args)
        return f"(if {x} > 0 then 1 elseif {x} < 0 then 0 else {middle})"

    def _print_Max(self, expr: sp.Max | sp.Min) -> str:
        text = str(self._print(expr.args[-1]))
        for part in reversed(expr.args[:-1]):
            text = f"{expr.func.__name__.lower()}({self._print(part)}, {text})"
        return text

    def _print_Mod(self, expr: sp.Mod) -> str:
        return f"mod({self._print(expr.args[0])}, {self._print(expr.args[1])})"

    def _print_Function(self, expr: sp.Function) -> str:
        kind = type(expr)
        if kind in _REWRITTEN:
            return str(self._print(expr.rewrite(_REWRITTEN[kind])))
        name = {sp.Abs: "abs", sp.ceiling: "ceil"}.get(kind, kind.__name__)
        return f"{name}({', '.join(map(self._print, expr.args))})"

    _print_Min = _print_Max  # noqa: N815
    # SymPy has special methods for these
    _print_Abs = _print_sign = _print_floor = _print_ceiling = _print_Function  # noqa: N815


def modelica(part: Component, starts: Mapping[str, float] | None = None) -> str:
    """The component as the text of a Modelica model of its name.

    Parameters
    ----------
    part : Component
    starts : mapping of str to float, optional
        Values of parameters and, by ``x_start``, of initial states in place of the defaults.

    Raises
    ------
    ContractError
        If it has modes, samples or delays, or a name is a keyword of Modelica.
    """
    instants = {"modes": part.modes, "samples": part.discrete, "delays": part.delays}
    for what, there in instants.items():
        if there:
            raise ContractError(
                f"{part.name} has {what}, which the Modelica export does not support; export it "
                "as an FMU"
            )
    states = {s.name: s for s in part.all_states}
    taken = {*states, *(p.name for p in part.all_parameters), *(i.name for i in part.inputs)}
    taken |= {o.name for o in part.all_outputs}
    if keyword := sorted({part.name, *taken} & {"pi", *_RESERVED}):
        raise ContractError(f"{part.name}: {keyword[0]} is a keyword of Modelica; use another name")
    taken |= {"pi", *_RESERVED, *(s + START for s in states)}
    own = {o.name for o in part.all_outputs if o.name in states and o.value == symbol(o.name)}
    starts = starts or {}
    lines = [f"model {part.name} {_said(part.description)}"]
    for p in part.all_parameters:
        bounds = [("min", p.minimum), ("max", p.maximum)]
        extra = {n: repr(float(v)) for n, v in bounds if math.isfinite(v)}
        value = starts.get(p.name, p.default)
        lines.append(_declared("parameter Real", p.name, p.unit, extra, p.meaning, value))
    for s in states.values():
        name, meaning = s.name + START, f"initial {s.meaning}"
        start = starts.get(name, s.start)
        lines.append(_declared("parameter Real", name, s.unit, {}, meaning, start))
    for i in part.inputs:
        extra = {"start": repr(float(i.start)), "nominal": repr(float(i.nominal))}
        lines.append(_declared("input Real", i.name, i.unit, extra, i.meaning))
    for s in states.values():
        extra = {"start": s.name + START, "fixed": "true", "nominal": repr(float(s.nominal))}
        kind = "output Real" if s.name in own else "Real"
        lines.append(_declared(kind, s.name, s.unit, extra, s.meaning))
    shown = [o for o in part.all_outputs if o.name not in own]
    for o in shown:
        extra = {"nominal": repr(float(o.nominal))}
        lines.append(_declared("output Real", o.name, o.unit, extra, o.meaning))
    forces, rates = _forces(part, taken)
    values = [*(f for _, f, _ in forces), *rates, *(o.value for o in shown)]
    shared, values = sp.cse(values, (symbol(n) for n in _free("part", taken)), order="none")
    plain = {name: value for name, value in shared if not value.free_symbols}  # only pi, numbers
    shared = [(n, v.subs(plain)) for n, v in shared if n not in plain]
    values = [v.subs(plain) for v in values]
    lefts = [*(n for n, _, _ in forces), *(f"der({n})" for n in states), *(o.name for o in shown)]
    if any(v.has(sp.pi) for v in (*values, *(e for _, e in shared))):
        lines.append(f"  constant Real pi = {math.pi!r};")
    if forces or shared:
        lines.append("protected")
    lines += [_declared("Real", name, "", {}, meaning) for name, _, meaning in forces]
    for name, value in shared:
        kind = "Boolean" if isinstance(value, Relational | BooleanFunction) else "Real"
        lines.append(f"  {kind} {name};")
    lines.append("equation")
    for name, value in shared:
        lines += _equation(str(name), _print(value))
    for left, value in zip(lefts, values, strict=True):
        lines += _equation(left, _print(value))
    lines.append("  annotation(experiment(StopTime = 1, Tolerance = 1e-8));")
    return "\n".join([*lines, f"end {part.name};", ""])


def _forces(
    part: Component, taken: set[str]
) -> tuple[list[tuple[str, sp.Expr, str]], list[sp.Expr]]:
    """Each force of a balance with its own name, and derivatives of states with these names."""
    forces, of_balance = [], {}
    for balance in part.balances:
        total: sp.Expr = sp.Integer(0)
        for term in balance.terms:
            name = next(_free(f"force_{term.name}", taken))
            forces.append((name, term.force, term.meaning))
            total += symbol(name)
        of_balance[balance.state] = total / balance.inertia
    pairs = zip(part.all_states, part.derivatives, strict=True)
    return forces, [of_balance.get(s.name, rate) for s, rate in pairs]


def _free(base: str, taken: set[str]) -> Iterator[str]:
    """Unused names: the base, then with numbers; each is then marked as used."""
    for k in itertools.count():
        name = f"{base}{k or ''}"
        if name not in taken:
            taken.add(name)
            yield name


def _print(expression: Any) -> str:
    return str(_Printer().doprint(sp.sympify(expression)))


def _declared(
    kind: str, name: str, unit: str, extra: dict[str, str], meaning: str, value: float | None = None
) -> str:
    inside = [f'unit="{_unit(unit)}"'] * bool(unit) + [f"{n}={v}" for n, v in extra.items()]
    text = f"  {kind} {name}" + (f"({', '.join(inside)})" if inside else "")
    text += "" if value is None else f" = {float(value)!r}"
    return f"{text} {_said(meaning)};"


def _said(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ") + '"'


def _unit(unit: str) -> str:
    """A unit in Modelica spelling: ``N.s/m`` for ``N*s/m``, ``m/s2`` for ``m/s^2``."""
    above, *below = unit.replace("^", "").replace("ohm", "Ohm").split("/")
    above = above.replace("*", ".")
    if not below:
        return above
    under = ".".join(part.strip("()").replace("*", ".") for part in below)
    return f"{above}/({under})" if "." in under else f"{above}/{under}"


def _equation(left: str, right: str) -> list[str]:
    """An equation, in several lines if it is long."""
    text = f"  {left} = {right};"
    lines: list[str] = []
    while len(text) > _WIDTH:
        at = max(text.rfind(sign, 20, _WIDTH) for sign in (" + ", " - ", " else", " then "))
        if at <= 20:
            break
        lines.append(text[:at])
        text = "      " + text[at:]
    return [*lines, text]
