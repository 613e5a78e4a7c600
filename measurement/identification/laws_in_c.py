"""The functions of the friction laws for ``c/laws.c``, derived from ``plant`` and written in C.

At constant velocity, the rate of a state is a - b z, for all forms except "power": the distance to
the equilibrium a/b falls by exp(-b h) in a time h. The product b h is called run here; for laws
independent of time it is a function of the distance moved. All functions are for forward motion,
because all laws are odd.

A wheel is built without SymPy, so the generated code is stored: ``python -m
ballscrew.measurement.identification.laws_in_c`` writes ``c/laws_from_plant.h``.
"""

from __future__ import annotations

import re
from pathlib import Path

import sympy as sp

from ...plant import LAWS
from ...plant.dahl import ROUNDING
from ...plant.law import claims, law
from ...plant.lugre import stribeck
from ...plant.modified_lugre import smooth_sign
from ...plant.two_masses import joint_force
from ...solver.codegen import as_python
from ...solver.component import ForceTerm, symbol
from ...solver.translation import expression_in_c
from .fitted_law import FORMS, fitted_law

HEADER = Path(__file__).parent / "c" / "laws_from_plant.h"
_HEAD = """\
/* Made from plant/ by `python -m ballscrew.measurement.identification.laws_in_c`; not for editing.
 *
 * q: parameters in the estimator's order; b: those of the side to which bristles are bent; i: an
 * element; s: sign of the velocity; g: the curve there. States of elements: their forces. */
"""
_V, _LEFT = (sp.Symbol(name, positive=True) for name in ("v", "left"))
_S, _G, _H, _WAY, _RATIO = map(symbol, ("s", "g", "h", "way", "ratio"))
_SCALARS = ("Fc", "Fs", "Vs", "z", "s", "v", "g", "h", "way", "Kv", "stiffness", "mass")
_OF_ELEMENT = re.compile(r"(k|alpha)\d")
# one law of each form with an exact step; of bristles the last, the modified law
_ONCE = [law for law in map(fitted_law, LAWS) if law.form != FORMS[-1] and not law.directional]
_OF = {law.form: law for law in _ONCE}


def header() -> str:
    """The text of ``c/laws_from_plant.h``."""
    firsts = [_names(form).index("Fc") if "Vs" in _names(form) else -1 for form in FORMS]
    curve = stribeck(_RATIO * symbol("Vs"))  # square the ratio, not numerator and denominator
    v = symbol("v")
    spring = sp.diff(joint_force(symbol("mass"), spring=True, gap=False), v)
    dry = _friction(law(_OF["dry"].name)(v)).xreplace({sp.sign(v): _S}).xreplace({stribeck(v): _G})
    lines = [
        f"enum {{ {', '.join(map(str.upper, FORMS))} }};",
        f"enum {{ COUNT = {len(_OF['elements'].together)} }}; /* of elements */",
        "/* place of Fc, Fs and Vs, the parameters of a form's curve; -1 without one */",
        f"static const int FIRST_OF_CURVE[] = {{{', '.join(map(str, firsts))}}};",
        *map(_structure, FORMS[:-1]),
        "",
        _function("", "stribeck", curve, ratio="(v / Vs)"),
        _function("", "smooth_sign", smooth_sign(v).evalf(17)),
        *(f for made in (_bristles, _power, _relaxing, _elements) for f in made()),
        _function("dry", "force", dry),
        _function("", "spring_damping", spring),
    ]
    return _HEAD + "\n".join([*lines, ""])


def _names(form: str) -> tuple[str, ...]:
    return _OF[form].parameters if form in _OF else ()


def _structure(form: str) -> str:
    """The parameters of a form; those of elements are arrays."""
    fields = [_OF_ELEMENT.sub(r"\1[COUNT]", n) for n in _names(form)]
    return f"typedef struct {{ double {', '.join(dict.fromkeys(fields))}; }} {form.title()};"


def _function(form: str, name: str, value: sp.Expr, **places: str) -> str:
    """An expression of a form as a function in C of its symbols; some are at `places`."""
    known = {n: "q->" + _OF_ELEMENT.sub(r"\1[i]", n) for n in _names(form)} | places
    written = expression_in_c(as_python(value))
    text = re.sub(r"[A-Za-z_]\w*", lambda word: known.get(word[0], word[0]), written)
    words = set(re.findall(r"(?<!->)\b\w+", text))
    arguments = [f"const {form.title()} *{n}" for n in ("q", "b") if n in words]
    arguments += ["const double *state"] if "state" in words else []
    arguments += ["int i"] if "i" in words else []
    arguments += [f"double {n}" for n in _SCALARS if n in words]
    called = f"{form}_{name}" if form else name
    head, body = f"static inline double {called}({', '.join(arguments)})", f"return {text};"
    line = f"{head} {{ {body} }}"
    return line if len(line) <= 100 else f"{head}\n{{\n    {body}\n}}"


def _term(form: str) -> ForceTerm:
    return law(_OF[form].name)(_V)


def _friction(term: ForceTerm) -> sp.Expr:
    return next(o.value for o in term.outputs if o.name == "friction")


def _settling(rate: sp.Expr, state: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
    """Equilibrium a/b and rate b of a state with the rate a - b z."""
    b = -sp.diff(rate, state)
    return rate.xreplace({state: sp.Integer(0)}) / b, b


def _bristles() -> list[str]:
    """Functions of the modified law; with a discontinuous sign it is the original law."""

    def of(value: sp.Expr) -> sp.Expr:
        return value.subs(smooth_sign(_V), _S).xreplace({stribeck(_V): _G})

    rest, b = _settling(of(_term("bristles").states[0].derivative), symbol("z"))
    run = b * _WAY / (_S * _V)
    return [
        _function("bristles", "force", of(_friction(_term("bristles"))), sigma0="b->sigma0"),
        _function("bristles", "rest", rest),
        _function("bristles", "run", run),
        _function("bristles", "length", _WAY / run),
    ]


def _power() -> list[str]:
    """The relative distance to the final force falls with a power of itself."""
    claim = claims(_OF["power"].name)
    steady, stiffness = map(sp.sympify, (claim.steady_state, claim.stiffness))
    rest = steady.subs(symbol("v"), _V)
    z = {symbol("z"): rest / stiffness * (1 - _LEFT)}
    rate = sp.sympify(_term("power").states[0].derivative)
    rate = rate.xreplace({ROUNDING**2: sp.Integer(0)}).subs(z)
    falling = sp.powsimp(stiffness / rest * rate)
    exponent = sp.simplify(_LEFT * sp.diff(falling, _LEFT) / falling)
    return [
        _function("power", "rest", rest),
        _function("power", "decay", sp.simplify(falling / _LEFT**exponent) / _V),
        _function("power", "exponent", exponent),
    ]


def _relaxing() -> list[str]:
    made = []
    for part, state in zip(("fast", "slow"), _term("relaxing").states, strict=True):
        rest, b = _settling(state.derivative, symbol(state.name))
        made.append(_function("relaxing", f"{part}_rest", sp.simplify(rest)))
        made.append(_function("relaxing", f"{part}_run", b * _WAY / _V))
    return made


def _elements() -> list[str]:
    count = len(_OF["elements"].together)
    places = {f"force{i}": f"state[{i - 1}]" for i in range(1, count + 1)}
    forces = {symbol(f"z{f[5:]}"): symbol(f) / symbol(f"k{f[5:]}") for f in places}
    rate = symbol("k1") * _term("elements").states[0].derivative
    rate = rate.xreplace({**forces, stribeck(_V): _G})
    sticking, slipping = (rate.xreplace({symbol("q1"): sp.Integer(k)}) for k in (0, 1))
    rest, b = _settling(slipping, symbol("force1"))
    return [
        _function("elements", "force", _friction(_term("elements")).xreplace(forces), **places),
        _function("elements", "loading", sticking * _WAY / _V),
        _function("elements", "rest", rest),
        _function("elements", "run", b * _H),
    ]


if __name__ == "__main__":
    HEADER.write_text(header(), encoding="utf-8")
