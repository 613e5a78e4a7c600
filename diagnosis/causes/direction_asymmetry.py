"""Friction that is larger one way than the other, its viscous part as well."""

from __future__ import annotations

import sympy as sp

from .cause import FRICTION, force_cause, parameter

CAUSE = force_cause(
    "direction_asymmetry",
    "friction is larger in one direction than in the other",
    {parameter("asymmetry", "1", "share by which friction is larger in +x"): sp.Abs(FRICTION)},
    confirm="run the same speeds both ways: the difference grows with the friction itself",
    mistaken_for=("load_bias", "nonlinear_viscous"),
)
