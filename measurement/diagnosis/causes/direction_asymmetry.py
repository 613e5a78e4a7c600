"""Friction that is larger in one direction: dry, viscous, or both with separate shares."""

from __future__ import annotations

import sympy as sp

from ....solver.component import symbol
from .cause import DRY, Cause, force, parameter
from .travel import changing, either_way, fast_speed, viscous_share

_SHARE = "asymmetry_viscous_share"
_SPEED = "V_asymmetry"
_ALIKE = force(
    {
        parameter("asymmetry", "1", "relative increase of friction in +x"): sp.Abs(
            changing(_SHARE, sp.Integer(1))
        )
    },
    (viscous_share(_SHARE),),
    lambda courses, model: either_way([{}], _SHARE),
)
_APART = force(
    {
        parameter("dry_asymmetry", "1", "relative increase of dry friction in +x"): sp.Abs(DRY),
        parameter("dF_asymmetry", "N", "by which the viscous one is, at V_asymmetry"): sp.Abs(
            symbol("v")
        )
        / symbol(_SPEED),
    },
    (parameter(_SPEED, "m/s", "speed at which that force is given", 1.0),),
    lambda courses, model: [{_SPEED: fast_speed(courses)}],
)
CAUSE = Cause(
    "direction_asymmetry",
    "friction is larger in one direction than in the other",
    (_ALIKE, _APART),
    confirm="run the same speeds in both directions: the difference is proportional to the "
    "friction",
    mistaken_for=("load_bias", "nonlinear_viscous"),
)
