"""Viscous friction that grows faster or slower than the velocity."""

from __future__ import annotations

import sympy as sp

from ....solver.component import symbol
from .cause import Cause, force, parameter
from .travel import fast_speed

_V = symbol("v")
_SLOWEST = sp.Float("1e-5")  # below this speed a root is replaced by a line [m/s]
_POWERS = (0.5, 1.5, 3.0)
_CHANGES = (0.1, 0.3, 1.0)  # speeds of the change, over the record's fast speed

_QUADRATIC = force(
    {parameter("sigma3", "N*s^2/m^2", "quadratic viscous coefficient"): _V * sp.Abs(_V)}
)
_POWER = force(
    {
        parameter("F_power", "N", "friction at viscous_speed minus that of the model"): _V
        / symbol("viscous_speed")
        * (sp.sqrt(_V**2 + _SLOWEST**2) / symbol("viscous_speed")) ** (symbol("viscous_power") - 1)
    },
    (
        parameter("viscous_power", "1", "power of the speed", 1.0),
        parameter("viscous_speed", "m/s", "speed at which the force is given", 1.0),
    ),
    lambda courses, model: [
        {"viscous_power": power, "viscous_speed": fast_speed(courses)} for power in _POWERS
    ],
)
_THINNING = force(
    {
        parameter("dsigma2", "N*s/m", "change of the viscous coefficient at high speed"): _V
        * sp.Abs(_V)
        / (sp.Abs(_V) + symbol("V_viscous"))
    },
    (parameter("V_viscous", "m/s", "speed at which half of that change is reached", 1.0),),
    lambda courses, model: [{"V_viscous": k * fast_speed(courses)} for k in _CHANGES],
)
CAUSE = Cause(
    "nonlinear_viscous",
    "friction at high speed is not proportional to the speed",
    (_QUADRATIC, _POWER, _THINNING),
    confirm="constant speeds up to the highest: friction over speed is not a straight line",
    mistaken_for=("stribeck_mismatch", "direction_asymmetry"),
)
