"""Classical friction with separate parameters for each direction: sticking, and sliding.

Coulomb and static friction, and the Stribeck curve, are those of most machines, in which they
differ by direction; names as in `directional_lugre`.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import ForceTerm, symbol
from .classical import CLAIMS as SAME_BOTH_WAYS
from .classical import USED, sliding, sticking_term
from .directional_lugre import PARAMETERS, one_way


def _friction(velocity: sp.Expr) -> sp.Expr:
    """The law of the direction, which is the sign of the velocity and in a mode its own."""
    sign = sp.sign(velocity)
    forwards = one_way(sliding(velocity, sp.Integer(1)), "pos")
    backwards = one_way(sliding(velocity, sp.Integer(-1)), "neg")
    return (1 + sign) / 2 * forwards + (1 - sign) / 2 * backwards


CLAIMS = replace(SAME_BOTH_WAYS, steady_state=_friction(symbol("v")))


def directional_classical(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]; needs `with_sticking`."""
    used = tuple(p for p in PARAMETERS if p.name.partition("_")[0] in USED)
    return sticking_term("classical friction that differs by direction", _friction(velocity), used)
