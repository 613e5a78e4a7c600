"""Viscous friction that grows faster, or slower, than the velocity."""

from __future__ import annotations

import sympy as sp

from ...solver.component import symbol
from .cause import force_cause, parameter

_V = symbol("v")

CAUSE = force_cause(
    "nonlinear_viscous",
    "friction at high speed is not proportional to the speed",
    {parameter("sigma3", "N*s^2/m^2", "quadratic viscous coefficient"): _V * sp.Abs(_V)},
    confirm="constant speeds up to the highest: friction over speed is bent",
    mistaken_for=("stribeck_mismatch", "direction_asymmetry"),
)
