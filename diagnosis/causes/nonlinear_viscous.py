"""Viscous friction that grows faster, or slower, than the velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import symbol
from .cause import Constants, Courses, Values, force_cause, of_forms, parameter
from .travel import fast_speed

if TYPE_CHECKING:
    from ..drive import Drive

_V = symbol("v")
_SLOWEST = sp.Float("1e-5")  # below it a root is a line [m/s]
_POWERS = (0.5, 1.5, 3.0)
_CHANGES = (0.1, 0.3, 1.0)  # of the record's fast speeds


def _powers(courses: Courses, model: Drive) -> list[Values]:
    del model
    fast = fast_speed(courses)
    return [{"viscous_power": power, "viscous_speed": fast} for power in _POWERS]


def _changes(courses: Courses, model: Drive) -> list[Values]:
    del model
    fast = fast_speed(courses)
    return [{"V_viscous": k * fast} for k in _CHANGES]


_QUADRATIC = force_cause(
    "nonlinear_viscous",
    "friction at high speed is not proportional to the speed",
    {parameter("sigma3", "N*s^2/m^2", "quadratic viscous coefficient"): _V * sp.Abs(_V)},
    confirm="constant speeds up to the highest: friction over speed is bent",
    mistaken_for=("stribeck_mismatch", "direction_asymmetry"),
)
_POWER = force_cause(
    _QUADRATIC.name,
    _QUADRATIC.says,
    {
        parameter("F_power", "N", "friction at viscous_speed beyond the model's"): _V
        / symbol("viscous_speed")
        * (sp.sqrt(_V**2 + _SLOWEST**2) / symbol("viscous_speed")) ** (symbol("viscous_power") - 1)
    },
    confirm=_QUADRATIC.confirm,
    constants=Constants(
        (
            parameter("viscous_power", "1", "power of the speed", 1.0),
            parameter("viscous_speed", "m/s", "speed at which the force is told", 1.0),
        ),
        _powers,
    ),
)
_THINNING = force_cause(
    _QUADRATIC.name,
    _QUADRATIC.says,
    {
        parameter("dsigma2", "N*s/m", "change of the viscous coefficient at high speed"): _V
        * sp.Abs(_V)
        / (sp.Abs(_V) + symbol("V_viscous"))
    },
    confirm=_QUADRATIC.confirm,
    constants=Constants(
        (parameter("V_viscous", "m/s", "speed at which half of that change has come", 1.0),),
        _changes,
    ),
)
CAUSE = of_forms(_QUADRATIC, _POWER, _THINNING)
