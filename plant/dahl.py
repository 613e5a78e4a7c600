"""Dahl friction with any exponent: Eqs. 1.2-1.3 of the thesis.

    dF/dx = sigma (1 - (F/Fc) sgn v)^alpha

If F reaches Fc, round-off can make the base negative. Its power is then the power of its magnitude
with its sign, so that F returns to Fc from either side; for alpha = 1 this changes nothing. For
exponents below one, F reaches Fc after a finite distance, where the slope of the equation is
infinite. The power is therefore b (b^2 + d^2)^((alpha-1)/2) with d = `ROUNDING`: exact for alpha =
1; otherwise inaccurate only if 1 - |F|/Fc is not much larger than d.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from ..solver.component import ForceTerm, Parameter, State, symbol
from .law import Claims, Estimation, friction_term

ROUNDING = sp.Float("1e-6")
_EXPONENT = "exponent; 1 is the usual one, below it F meets Fc after a finite way"

PARAMETERS = (
    Parameter("sigma", 87750.0, "N/m", "slope dF/dx at F = 0", "Table 2.5, nominal", minimum=1e-3),
    Parameter("Fc", 2.0, "N", "Coulomb friction", "Table 2.5, nominal", minimum=1e-9),
    Parameter("alpha", 1.0, "1", _EXPONENT, "Section 2.3.2.1", minimum=0.0, maximum=10.0),
)


def _guesses(seen: Mapping[str, float]) -> list[dict[str, float]]:
    return [{"sigma": seen["stiffness"], "Fc": seen["largest"], "alpha": a} for a in (1.0, 2.0)]


CLAIMS = Claims(
    steady_state=symbol("Fc") * sp.sign(symbol("v")),
    stiffness=symbol("sigma"),
    follows_path_only=True,
    # it bends from the start, so that the stiffness is not seen without the end of the bend, too
    estimation=Estimation("power", _guesses, of_break_away=("sigma", "Fc", "alpha")),
)


def dahl(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    sigma, fc, alpha, z = map(symbol, ("sigma", "Fc", "alpha", "z"))

    def slope(share: sp.Expr) -> sp.Expr:
        left = 1 - share
        return left * (left**2 + ROUNDING**2) ** ((alpha - 1) / 2)

    share = sigma * z / fc
    rate = velocity * sp.Piecewise((slope(share), velocity >= 0), (slope(-share), True))
    deflection = State("z", "m", "deflection, friction over sigma", rate, nominal=1e-5)
    return friction_term("Dahl friction", sigma * z, PARAMETERS, [deflection])
