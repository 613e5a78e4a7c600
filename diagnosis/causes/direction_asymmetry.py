"""Friction that is larger one way than the other, its viscous part as well or not."""

from __future__ import annotations

import sympy as sp

from .cause import force_cause, parameter
from .travel import changing, either_way, viscous_share

_SHARE = "asymmetry_viscous_share"

CAUSE = force_cause(
    "direction_asymmetry",
    "friction is larger in one direction than in the other",
    {
        parameter("asymmetry", "1", "share by which friction is larger in +x"): sp.Abs(
            changing(_SHARE, sp.Integer(1))
        )
    },
    confirm="run the same speeds both ways: the difference grows with the friction itself",
    mistaken_for=("load_bias", "nonlinear_viscous"),
    constants=(viscous_share(_SHARE),),
    grid=lambda courses, model: either_way([{}], _SHARE),
)
