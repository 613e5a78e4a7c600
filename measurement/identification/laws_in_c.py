"""The functions of the friction laws for ``c/laws.c``, derived from ``plant`` and written in C.

At constant velocity, the rate of a state is a - b z, for all laws except Dahl's: the distance to
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

from ...plant.dahl import ROUNDING
from ...plant.law import claims, law
from ...plant.lugre import stribeck
from ...plant.maxwell_slip import ELEMENTS
from ...plant.modified_lugre import smooth_sign
from ...plant.two_masses import joint_force
from ...solver.codegen import as_python
from ...solver.component import ForceTerm, symbol
from ...solver.translation import expression_in_c
from .fitted_law import LAWS

HEADER = Path(__file__).parent / "c" / "laws_from_plant.h"
_HEAD = f"""\
/* Made from plant/ by `python -m ballscrew.measurement.identification.laws_in_c`; not for editing.
 *
 * q: parameters in the estimator's order; b: those of the side to which bristles are bent; i: an
 * element; s: sign of the velocity; g: the curve there. States of Dahl and Maxwell slip: forces. */
enum {{ ELEMENTS = {ELEMENTS}, LUGRE_PARAMETERS = {len(LAWS["lugre"].parameters)} }};
"""
_V, _LEFT = (sp.Symbol(name, positive=True) for name in ("v", "left"))
_S, _G, _H, _WAY, _RATIO = map(symbol, ("s", "g", "h", "way", "ratio"))
_POINTERS = ("state", "q", "b")
_SCALARS = ("s", "v", "g", "h", "way", "Kv", "stiffness", "mass")


def header() -> str:
    """The text of ``c/laws_from_plant.h``."""
    functions = (*_curves(), *_lugre(), *_dahl(), *_bliman_sorine(), *_maxwell_slip())
    classical = _friction(law("classical")(symbol("v"))).xreplace({sp.sign(symbol("v")): _S})
    last = _function("classical", "friction", classical.xreplace({stribeck(symbol("v")): _G}))
    spring = sp.diff(joint_force(symbol("mass"), spring=True, gap=False), symbol("v"))
    return "\n".join((_HEAD, *functions, last, _function("spring", "damping", spring)))


def _function(of: str, name: str, value: sp.Expr, **places: str) -> str:
    """An expression of a law, or of a joint, as a function in C of its symbols."""
    parameters = LAWS[of].parameters if of in LAWS else ()
    known = {p: f"q[{k}]" for k, p in enumerate(parameters)} | places
    used = {s.name for s in value.free_symbols}
    local = {n: place for n, place in known.items() if n in used}
    words = (used - {*local}).union(*(re.findall(r"\w+", place) for place in local.values()))
    arguments = [f"const double *{n}" for n in _POINTERS if n in words]
    arguments += ["int i"] if "i" in words else []
    arguments += [f"double {n}" for n in _SCALARS if n in words]
    lines = [f"static inline double {of}_{name}({', '.join(arguments)})", "{"]
    lines += [f"    const double {n} = {place};" for n, place in local.items()]
    return "\n".join([*lines, f"    return {expression_in_c(as_python(value))};", "}\n"])


def _friction(term: ForceTerm) -> sp.Expr:
    return next(o.value for o in term.outputs if o.name == "friction")


def _settling(rate: sp.Expr, state: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
    """Equilibrium a/b and rate b of a state with the rate a - b z."""
    b = -sp.diff(rate, state)
    return rate.xreplace({state: sp.Integer(0)}) / b, b


def _curves() -> list[str]:
    made = []
    for name in ("lugre", "maxwell_slip", "classical"):
        vs = f"q[{LAWS[name].parameters.index('Vs')}]"
        curve = stribeck(_RATIO * symbol("Vs"))  # square the ratio, not numerator and denominator
        made.append(_function(name, "curve", curve, ratio=f"v / {vs}"))
        if name == "lugre":  # the additional bend is a curve that falls to zero
            more = curve.xreplace({symbol("Fc"): sp.Integer(0)})
            places = {"Fs": "q[LUGRE_PARAMETERS]", "ratio": "v / q[LUGRE_PARAMETERS + 1]"}
            made.append(_function(name, "bend", more, **places))
        if name != "classical":
            made.append(_function(name, "curve_at_rest", stribeck(sp.Integer(0))))
    return made


def _lugre() -> list[str]:
    """Functions of the modified law; with a discontinuous sign it is the original law."""
    term, sign = law("modified_lugre")(_V), smooth_sign(_V)

    def of(value: sp.Expr) -> sp.Expr:
        return value.subs(sign, _S).xreplace({stribeck(_V): _G})

    rest, b = _settling(of(term.states[0].derivative), symbol("z"))
    run = b * _WAY / (_S * _V)
    own = {"sigma0": "b[0]", "z": "state[0]"}
    return [
        _function("lugre", "sign", sign.evalf(17)),
        _function("lugre", "friction", of(_friction(term)), **own),
        _function("lugre", "rest", rest),
        _function("lugre", "run", run),
        _function("lugre", "length", _WAY / run),
    ]


def _dahl() -> list[str]:
    """Dahl's law: the relative distance to the final force falls with a power of itself."""
    term, claim = law("dahl")(_V), claims("dahl")
    steady, stiffness = map(sp.sympify, (claim.steady_state, claim.stiffness))
    rest = steady.subs(symbol("v"), _V)
    z = {symbol("z"): rest / stiffness * (1 - _LEFT)}
    rate = sp.sympify(term.states[0].derivative).xreplace({ROUNDING**2: sp.Integer(0)}).subs(z)
    falling = sp.powsimp(stiffness / rest * rate)
    exponent = sp.simplify(_LEFT * sp.diff(falling, _LEFT) / falling)
    force = _friction(term).subs(symbol("z"), symbol("force") / stiffness)
    return [
        _function("dahl", "friction", force, force="state[0]"),
        _function("dahl", "rest", rest),
        _function("dahl", "decay", sp.simplify(falling / _LEFT**exponent) / _V),
        _function("dahl", "exponent", exponent),
    ]


def _bliman_sorine() -> list[str]:
    term = law("bliman_sorine")(_V)
    places = {s.name: f"state[{k}]" for k, s in enumerate(term.states)}
    made = [_function("bliman_sorine", "friction", _friction(term), **places)]
    for part, state in zip(("fast", "slow"), term.states, strict=True):
        rest, b = _settling(state.derivative, symbol(state.name))
        made.append(_function("bliman_sorine", f"{part}_rest", sp.simplify(rest)))
        made.append(_function("bliman_sorine", f"{part}_run", b * _WAY / _V))
    return made


def _maxwell_slip() -> list[str]:
    term = law("maxwell_slip")(_V)
    places = {f"force{i}": f"state[{i - 1}]" for i in range(1, ELEMENTS + 1)}
    forces = {symbol(f"z{f[5:]}"): symbol(f) / symbol(f"k{f[5:]}") for f in places}
    rate = (symbol("k1") * term.states[0].derivative).xreplace({**forces, stribeck(_V): _G})
    sticking, slipping = (rate.xreplace({symbol("q1"): sp.Integer(k)}) for k in (0, 1))
    rest, b = _settling(slipping, symbol("force1"))
    own = {"k1": "q[i]", "alpha1": "q[ELEMENTS + i]"}
    return [
        _function("maxwell_slip", "friction", _friction(term).xreplace(forces), **places),
        _function("maxwell_slip", "loading", sticking * _WAY / _V, **own),
        _function("maxwell_slip", "rest", rest, **own),
        _function("maxwell_slip", "run", b * _H, **own),
    ]


if __name__ == "__main__":
    HEADER.write_text(header(), encoding="utf-8")
