"""Friction that swings once a turn of the screw: it flips its sign with the velocity."""

from __future__ import annotations

import sympy as sp

from ...solver.component import symbol
from .cause import force_cause, parameter
from .travel import changing, either_way, periods, viscous_share

_SHARE = "periodic_viscous_share"
_ANGLE = 2 * sp.pi * symbol("periods_per_metre") * symbol("x")

_FRICTION = changing(_SHARE)

CAUSE = force_cause(
    "position_periodic_friction",
    "friction swings with the turn of the screw",
    {
        parameter("friction_cos", "1", "share of friction with the cosine of the turn"): _FRICTION
        * sp.cos(_ANGLE),
        parameter("friction_sin", "1", "share of friction with the sine of the turn"): _FRICTION
        * sp.sin(_ANGLE),
    },
    confirm="move slowly over a few turns both ways: the swing changes sign with the direction",
    mistaken_for=("torque_ripple",),
    constants=(
        parameter("periods_per_metre", "1/m", "swings per metre", 1.0),
        viscous_share(_SHARE),
    ),
    grid=lambda courses, model: either_way(
        periods(courses, model, "periods_per_metre", (1,), flips=True), _SHARE
    ),
    per_record=True,
)
