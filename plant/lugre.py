"""LuGre friction as first published, with |v|: Eqs. 1.5-1.7 and 3.8 of the thesis.

With a constant sigma1 the law is passive if and only if sigma2 >= sigma1 (Fs - Fc)/Fc (N. Barahanov
and R. Ortega, IEEE Transactions on Automatic Control 45, 830 (2000)). The values of the thesis,
173 and 286, do not satisfy it: fast pulses of 1 m/s extract work from bristles that were bent
slowly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import sympy as sp

from ..solver.component import ForceTerm, Parameter, State, symbol
from .law import Claims, Estimation, friction_term

_TABLES = "Tables 2.3 and 3.1"
_DAMPING = "Table 3.1; 2 sqrt(sigma0 m) - sigma2 by Eq. 2.17"
PARAMETERS = (
    Parameter(
        "sigma0", 66967.231, "N/m", "stiffness of the bristles", "Tables 2.9 and 3.1", minimum=1e-3
    ),
    Parameter("sigma1", 344.56, "N*s/m", "damping of the bristles", _DAMPING, minimum=0.0),
    Parameter("sigma2", 173.0, "N*s/m", "viscous friction coefficient", _TABLES, minimum=0.0),
    Parameter("Fc", 1.284, "N", "Coulomb friction", _TABLES, minimum=1e-9),
    Parameter("Fs", 2.35, "N", "break-away force", _TABLES, minimum=1e-9),
    Parameter("Vs", 0.00113975, "m/s", "Stribeck velocity", _TABLES, minimum=1e-9),
)


def stribeck(velocity: sp.Expr) -> sp.Expr:
    """g(v) = Fc + (Fs - Fc) exp(-(v/Vs)^2), Eq. 3.16 [N]."""
    fc, fs, vs = map(symbol, ("Fc", "Fs", "Vs"))
    return fc + (fs - fc) * sp.exp(-((velocity / vs) ** 2))


PASSIVE_MARGIN = symbol("sigma2") - symbol("sigma1") * (
    sp.Max(symbol("Fs"), symbol("Fc")) / sp.Min(symbol("Fs"), symbol("Fc")) - 1
)
"""Viscous coefficient minus the largest negative effect of the bristles' damping [N*s/m]."""


def _guesses(seen: Mapping[str, float]) -> list[dict[str, float]]:
    return [{"sigma0": seen["stiffness"], "sigma1": 2 * math.sqrt(seen["stiffness"])}]


CLAIMS = Claims(
    steady_state=stribeck(symbol("v")) * sp.sign(symbol("v")) + symbol("sigma2") * symbol("v"),
    stiffness=symbol("sigma0"),
    passive_if=PASSIVE_MARGIN >= 0,
    lags=True,
    breaks_away_sooner_when_loaded_faster=True,
    estimation=Estimation("bristles", _guesses, unseen=("Kv",)),
)


def lugre(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    sigma0, sigma1, sigma2, z = map(symbol, ("sigma0", "sigma1", "sigma2", "z"))
    deflection_rate = velocity - sigma0 * sp.Abs(velocity) / stribeck(velocity) * z
    force = sigma0 * z + sigma1 * deflection_rate + sigma2 * velocity
    bristles = State("z", "m", "mean bristle deflection", deflection_rate, nominal=1e-5)
    return friction_term("LuGre friction", force, PARAMETERS, [bristles])
