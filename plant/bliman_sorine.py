"""Bliman-Sorine friction: Eq. 1.4 of the thesis.

Two linear systems in the distance travelled, a fast one of strength f1 and a slow one of opposite
strength f2: friction rises above its sliding value f1 - f2 and returns to it. From rest it
peaks at f1 - f2 + f2 (1 - eta) (eta f2/f1)^(eta/(1-eta)) (Eq. 2.18 prints 1/(1-eta)).

The law is passive if and only if the real part of the transfer function
from sgn(v) to F, over distance, is nowhere negative: f1 >= f2 and f1 >= eta^2 f2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import sympy as sp

from ..solver.component import ForceTerm, Output, Parameter, State, symbol
from .law import Claims, Estimation, friction_term

_SOURCE = "Table 2.7, row 6"
_SHARE = "distance constant of the fast part, in that of the slow one"

PARAMETERS = (
    Parameter("f1", 19.875, "N", "strength of the fast part", _SOURCE, minimum=1e-9),
    Parameter("f2", 17.8227, "N", "strength of the slow part", _SOURCE, minimum=0.0),
    Parameter("eps_f", 0.000121, "m", "distance constant of the slow part", _SOURCE, minimum=1e-9),
    Parameter("eta", 0.9063, "1", _SHARE, _SOURCE, minimum=1e-6, maximum=1.0),
)

_F1, _F2, _EPS, _ETA = map(symbol, ("f1", "f2", "eps_f", "eta"))
_STIFFNESS = (_F1 / _ETA - _F2) / _EPS


def _guesses(seen: Mapping[str, float]) -> list[dict[str, float]]:
    f2 = 1.5 * seen["sliding"]
    f1 = seen["sliding"] + f2
    two = [{"f1": f1, "f2": f2, "eta": eta} for eta in (0.3, 0.7)]
    return [g | {"eps_f": (f1 / g["eta"] - f2) / seen["stiffness"]} for g in two]


def _parameters(least: Any, gone: Any, eps_f: Any, odds: Any) -> Iterable[Any]:
    """f1 and f2 grow together as eta nears one; f1 - f2 and f2 (1 - eta) hardly change."""
    f2 = gone * (1 + odds)
    return least + f2, f2, eps_f, odds / (1 + odds)


def _numbers(f1: Any, f2: Any, eps_f: Any, eta: Any) -> Iterable[Any]:
    return f1 - f2, f2 * (1 - eta), eps_f, eta / (1 - eta)


CLAIMS = Claims(
    steady_state=(_F1 - _F2) * sp.sign(symbol("v")),
    stiffness=_STIFFNESS,
    passive_if=sp.And(_F1 >= _F2, _F1 >= _ETA**2 * _F2),
    follows_path_only=True,
    estimation=Estimation("relaxing", _guesses, ("f1", "f2", "eta"), _parameters, _numbers),
)


def bliman_sorine(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    fast, slow = symbol("xs1"), symbol("xs2")
    speed = sp.Abs(velocity)
    force = fast + slow
    states = (
        State(
            "xs1", "N", "fast part of the friction", (_F1 * velocity - speed * fast) / (_ETA * _EPS)
        ),
        State("xs2", "N", "slow part of the friction", -(_F2 * velocity + speed * slow) / _EPS),
    )
    shown = [Output(s.name, s.unit, s.meaning, symbol(s.name)) for s in states]
    meaning = "friction over the stiffness at rest"
    shown.append(Output("z", "m", meaning, force / _STIFFNESS, nominal=1e-5))
    return friction_term("Bliman-Sorine friction", force, PARAMETERS, states, shown)
