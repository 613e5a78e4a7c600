"""LuGre friction with a smooth |v|, after the thesis' Eqs. 3.9-3.10 and 3.16."""

from __future__ import annotations

import sympy as sp

from ..solver.component import ForceTerm, Output, Parameter, State, symbol
from .lugre import PARAMETERS, stribeck

KV = Parameter("Kv", 1e8, "s/m", "sharpness of the smooth sign function", "Table 3.1", minimum=1e-3)


def smooth_sign(velocity: sp.Expr) -> sp.Expr:
    """S(v) = (2/pi) atan(Kv v), Eq. 3.10."""
    return 2 / sp.pi * sp.atan(symbol("Kv") * velocity)


def modified_lugre(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    sigma0, sigma1, sigma2, z = map(symbol, ("sigma0", "sigma1", "sigma2", "z"))
    sign = smooth_sign(velocity)
    deflection_rate = sign**2 * velocity - sigma0 * sign * velocity / stribeck(velocity) * z
    force = sigma0 * z + sigma1 * deflection_rate + sigma2 * velocity
    return ForceTerm(
        name="friction",
        force=-force,
        meaning="modified LuGre friction, opposing motion",
        states=(State("z", "m", "mean bristle deflection", deflection_rate, nominal=1e-5),),
        parameters=(*PARAMETERS, KV),
        outputs=(Output("friction", "N", "friction force, opposing motion", force, nominal=1.0),),
    )
