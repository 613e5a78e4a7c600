"""Modified LuGre friction with separate parameters for each direction.

Table 2.3 of the thesis identifies Fc, Fs, Vs and sigma2 for each direction and then averages them.
Here they are kept separate: names end in ``_pos`` for motion in +x and in ``_neg`` for motion in
-x. The stiffness depends on the direction in which the bristles are bent, the sign of z, not on the
direction of motion: otherwise the force would jump at each reversal, and a small oscillation could
generate energy. With the same values for both directions the law is `modified_lugre`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import sympy as sp

from ..solver.component import ForceTerm, Parameter, State, symbol
from .law import friction_term
from .lugre import PARAMETERS as LUGRE
from .lugre import PASSIVE_MARGIN, stribeck
from .modified_lugre import CLAIMS as SAME_BOTH_WAYS
from .modified_lugre import KV, lowest_passive_speed, smooth_sign

_NOMINAL = {p.name: p.default for p in LUGRE}

_COLUMNS = {
    "pos": {"sigma2": 193.4, "Fc": 1.11, "Fs": 2.3, "Vs": 0.001943},
    "neg": {"sigma2": 152.6, "Fc": 1.458, "Fs": 2.4, "Vs": 0.0003365},
}
_SIDES = {"pos": "in +x", "neg": "in -x"}


def _parameters() -> tuple[Parameter, ...]:
    made = []
    for side, words in _SIDES.items():
        table = _COLUMNS[side]
        for p in LUGRE:
            default, source = p.default, "Table 2.9, the same both ways"
            if p.name in table:
                default, source = table[p.name], "Table 2.3"
            elif p.name == "sigma1":
                default = 2 * math.sqrt(_NOMINAL["sigma0"]) - table["sigma2"]
                source = "Eq. 2.17 with this direction's sigma2 and 1 kg"
            meaning = f"{p.meaning}, {words}"
            made.append(
                replace(p, name=f"{p.name}_{side}", default=default, meaning=meaning, source=source)
            )
    return (*made, KV)


PARAMETERS = _parameters()


def one_way(expression: sp.Expr, side: str) -> sp.Expr:
    """An expression of the modified LuGre law with the parameters of one direction."""
    return expression.xreplace({symbol(p.name): symbol(f"{p.name}_{side}") for p in LUGRE})


def _by(sign: sp.Expr, expression: sp.Expr) -> sp.Expr:
    """`expression` with the parameters of the direction given by `sign`."""
    return sp.Piecewise((one_way(expression, "pos"), sign >= 0), (one_way(expression, "neg"), True))


def _both(expression: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    return one_way(expression, "pos"), one_way(expression, "neg")


CLAIMS = replace(
    SAME_BOTH_WAYS,
    steady_state=_by(symbol("v"), SAME_BOTH_WAYS.steady_state),
    stiffness=_by(symbol("v"), symbol("sigma0")),
    passive_if=sp.And(*_both(SAME_BOTH_WAYS.passive_if)),
    passive_above=lowest_passive_speed(
        sp.Max(*_both(symbol("Fs"))), sp.Min(*_both(symbol("Fc"))), sp.Min(*_both(PASSIVE_MARGIN))
    ),
)


def directional_lugre(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    z, sign = symbol("z"), smooth_sign(velocity)
    elastic = _by(z, symbol("sigma0") * z)
    rate = sign**2 * velocity - sign * velocity * elastic / _by(velocity, stribeck(velocity))
    damping, viscous = _by(velocity, symbol("sigma1")), _by(velocity, symbol("sigma2"))
    force = elastic + damping * rate + viscous * velocity
    bristles = State("z", "m", "mean bristle deflection", rate, nominal=1e-5)
    return friction_term("LuGre friction that differs by direction", force, PARAMETERS, [bristles])
