"""LuGre friction with a smooth |v|, after Eqs. 3.9-3.10 and 3.16 of the thesis.

Below |v| of about 1/Kv the bristles do not follow the motion. Bristles that were bent fast can be
released slowly without relaxing, which generates energy: passivity needs, in addition to the
condition of LuGre, motion that does not stay at such speeds.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import ForceTerm, Parameter, State, symbol
from .law import friction_term
from .lugre import CLAIMS as ORIGINAL
from .lugre import PARAMETERS, PASSIVE_MARGIN, stribeck

KV = Parameter("Kv", 1e8, "s/m", "sharpness of the smooth sign function", "Table 3.1", minimum=1e-3)


def smooth_sign(velocity: sp.Expr) -> sp.Expr:
    """S(v) = (2/pi) atan(Kv v), Eq. 3.10."""
    return 2 / sp.pi * sp.atan(symbol("Kv") * velocity)


def lowest_passive_speed(largest: sp.Expr, least: sp.Expr, margin: sp.Expr) -> sp.Expr:
    """Speed above which viscous losses exceed the power that lagging bristles can return [m/s].

    That is at most |sigma0 z dz/dt| (1/S^2 - 1), with |sigma0 z| <= `largest` force [N], |dz/dt| <=
    |v| (1 + `largest`/`least`) and 1/S^2 - 1 just above 4/(pi Kv |v|); it is compared with `margin`
    v^2, the margin in N*s/m.
    """
    return sp.sqrt(5 * largest * (1 + largest / least) / (sp.pi * symbol("Kv") * margin))


CLAIMS = replace(
    ORIGINAL,
    steady_state=smooth_sign(symbol("v")) * stribeck(symbol("v")) + symbol("sigma2") * symbol("v"),
    passive_if=PASSIVE_MARGIN > 0,
    passive_above=lowest_passive_speed(
        sp.Max(symbol("Fs"), symbol("Fc")), sp.Min(symbol("Fs"), symbol("Fc")), PASSIVE_MARGIN
    ),
)


def modified_lugre(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    sigma0, sigma1, sigma2, z = map(symbol, ("sigma0", "sigma1", "sigma2", "z"))
    sign = smooth_sign(velocity)
    deflection_rate = sign**2 * velocity - sigma0 * sign * velocity / stribeck(velocity) * z
    force = sigma0 * z + sigma1 * deflection_rate + sigma2 * velocity
    bristles = State("z", "m", "mean bristle deflection", deflection_rate, nominal=1e-5)
    return friction_term("modified LuGre friction", force, (*PARAMETERS, KV), [bristles])
