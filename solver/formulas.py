"""Equations for a page: MathML that browsers show without a script, in parts that fit on a line."""

from __future__ import annotations

import re
from html.entities import html5
from typing import Any

import sympy as sp
from sympy.core.function import _coeff_isneg
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import Boolean
from sympy.printing.mathml import MathMLPresentationPrinter

MOST_SIGNS = 48  # letters in a part
_SETTINGS = {"mul_symbol": "dot"}  # names have several letters
_NAMEABLE = (sp.Expr, Boolean)


class _Printer(MathMLPresentationPrinter):  # type: ignore[misc]
    """The printer of SymPy, with branches after a brace and signs as text, not tags."""

    def mathml_tag(self, e: Any) -> str:
        tag = str(super().mathml_tag(e))
        return {"<": "&lt;", ">": "&gt;"}.get(tag, tag)

    def _element(self, name: str, *children: Any) -> Any:
        element = self.dom.createElement(name)
        for child in children:
            text = isinstance(child, str)
            element.appendChild(self.dom.createTextNode(child) if text else child)
        return element

    def _branches(self, branches: list[tuple[Any, Any]]) -> Any:
        rows = []
        for value, condition in branches:
            when = [self._element("mtext", "otherwise")]
            if condition != sp.true:
                when = [self._element("mtext", "if&#160;"), self._print(condition)]
            cells = self._element("mtd", self._print(value)), self._element("mtd", *when)
            rows.append(self._element("mtr", *cells))
        table = self._element("mtable", *rows)
        table.setAttribute("columnalign", "left")
        return self._element("mrow", self._element("mo", "{"), table)

    def _print_Piecewise(self, e: sp.Piecewise) -> Any:
        return self._branches([(pair.expr, pair.cond) for pair in e.args])

    def _print_ITE(self, e: sp.ITE) -> Any:
        condition, yes, no = e.args
        return self._branches([(yes, condition), (no, sp.true)])


def formula(expression: sp.Basic) -> str:
    """MathML of an expression, without the element ``math`` around it."""
    text = str(_Printer(_SETTINGS).doprint(expression))
    return re.sub(r"&(\w+);", lambda named: _character(named[1]), text)


def _character(entity: str) -> str:
    """A character by its number, valid in XML too; control characters are left out."""
    if entity in ("lt", "gt", "amp"):
        return f"&{entity};"
    return f"&#{ord(html5[entity + ';'])};"


def label(text: str) -> str:
    """Words as MathML."""
    plain = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return f"<mtext>{plain}</mtext>"


class Writer:
    """Writes right-hand sides, and gives names to parts that are too long for a line.

    Parameters
    ----------
    taken : set of str
        Names that are already used.
    """

    def __init__(self, taken: set[str]) -> None:
        symbols = sp.numbered_symbols("c", start=1, real=True)
        self._names = (s for s in symbols if s.name not in taken)
        self._parts: dict[sp.Basic, sp.Symbol] = {}

    def line(self, expression: sp.Basic) -> list[str]:
        """MathML of each term of a sum, so that a page can break the line between them."""
        terms = [self._shortened(t) for t in sp.Add.make_args(sp.sympify(expression))]
        total = sp.Add(*terms, evaluate=False) if len(terms) > 1 else terms[0]
        if not isinstance(total, sp.Add):
            return [formula(total)]
        lines: list[str] = []
        for term in _Printer(_SETTINGS)._as_ordered_terms(total):
            negative = _coeff_isneg(term)
            sign = "<mo>-</mo>" if negative else "<mo>+</mo>" if lines else ""
            lines.append(sign + formula(-term if negative else term))
        return lines

    def rest(self) -> list[list[str]]:
        """A row for each part that was named: its name, then its line."""
        rows: list[list[str]] = []
        while len(rows) < len(self._parts):  # a part may need parts of its own
            expression, name = list(self._parts.items())[len(rows)]
            rows.append([formula(name), *self.line(expression)])
        return rows

    def _shortened(self, e: sp.Basic) -> sp.Basic:
        if not e.args:
            return e
        parts = [self._shortened(a) for a in e.args]
        while not isinstance(e, sp.Piecewise) and sum(map(_signs, parts)) > MOST_SIGNS:
            able = [k for k, a in enumerate(parts) if a.args and isinstance(a, _NAMEABLE)]
            if not able:
                break
            longest = max(able, key=lambda k: _signs(parts[k]))
            parts[longest] = self._named(parts[longest])
        return ExprCondPair(*parts) if isinstance(e, ExprCondPair) else e.func(*parts)

    def _named(self, e: sp.Basic) -> sp.Symbol:
        if e not in self._parts:
            self._parts[e] = next(self._names)
        return self._parts[e]


def _signs(e: sp.Basic) -> float:
    """Approximate width of an expression, in letters."""
    if isinstance(e, sp.Symbol):
        return 1.0 + len(e.name)
    if not e.args:
        return 2.0
    parts = [_signs(a) for a in e.args]
    if isinstance(e, sp.Piecewise):
        return max(parts)
    if isinstance(e, sp.Pow) and e.exp.is_negative:  # below a line
        return max(parts)
    return sum(parts) + 2.0 * (len(parts) - 1)
