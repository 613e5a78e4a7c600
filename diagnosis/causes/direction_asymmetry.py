"""Friction that is larger one way than the other: dry, viscous, or both by shares of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import symbol
from .cause import DRY, Constants, Courses, Values, force_cause, of_forms, parameter
from .travel import changing, either_way, fast_speed, viscous_share

if TYPE_CHECKING:
    from ..drive import Drive

_SHARE = "asymmetry_viscous_share"
_SPEED = "V_asymmetry"


def _fast(courses: Courses, model: Drive) -> list[Values]:
    del model
    return [{_SPEED: fast_speed(courses)}]


_ALIKE = force_cause(
    "direction_asymmetry",
    "friction is larger in one direction than in the other",
    {
        parameter("asymmetry", "1", "share by which friction is larger in +x"): sp.Abs(
            changing(_SHARE, sp.Integer(1))
        )
    },
    confirm="run the same speeds both ways: the difference grows with the friction itself",
    mistaken_for=("load_bias", "nonlinear_viscous"),
    constants=Constants((viscous_share(_SHARE),), lambda courses, model: either_way([{}], _SHARE)),
)
_APART = force_cause(
    _ALIKE.name,
    _ALIKE.says,
    {
        parameter("dry_asymmetry", "1", "share by which dry friction is larger in +x"): sp.Abs(DRY),
        parameter("dF_asymmetry", "N", "by which the viscous one is, at V_asymmetry"): sp.Abs(
            symbol("v")
        )
        / symbol(_SPEED),
    },
    confirm=_ALIKE.confirm,
    constants=Constants(
        (parameter(_SPEED, "m/s", "speed at which that force is told", 1.0),), _fast
    ),
)
CAUSE = of_forms(_ALIKE, _APART)
