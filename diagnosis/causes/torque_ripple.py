"""A force that swings with the motor's angle and does not ask for the direction of motion."""

from __future__ import annotations

import sympy as sp

from ...solver.component import symbol
from .cause import force_cause, parameter
from .travel import periods

_ANGLE = 2 * sp.pi * symbol("ripples_per_metre") * symbol("x")

CAUSE = force_cause(
    "torque_ripple",
    "the drive's force swings with the motor's angle, whichever way it turns",
    {
        parameter("ripple_cos", "N", "force with the cosine of the angle"): sp.cos(_ANGLE),
        parameter("ripple_sin", "N", "force with the sine of the angle"): sp.sin(_ANGLE),
    },
    confirm="move slowly over a few turns both ways: the swing keeps its sign",
    mistaken_for=("position_periodic_friction",),
    constants=(parameter("ripples_per_metre", "1/m", "swings per metre", 1.0),),
    grid=lambda courses, model: periods(
        courses, model, "ripples_per_metre", range(1, 9), flips=False
    ),
    per_record=True,
    on_screw=True,
)
