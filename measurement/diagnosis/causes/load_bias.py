"""A constant force, for example gravity, a long spring or an amplifier's offset."""

from __future__ import annotations

import sympy as sp

from .cause import Cause, force, parameter

CAUSE = Cause(
    "load_bias",
    "a constant force acts on the block",
    (force({parameter("load", "N", "constant force against motion in +x"): sp.Integer(1)}),),
    confirm="measure the force that just moves the block in both directions: the two differ, by "
    "the same amount at all speeds",
    mistaken_for=("direction_asymmetry",),
)
