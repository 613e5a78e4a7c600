"""Friction that swings along the travel, as with the turn of the screw or of the balls.

It flips its sign with the velocity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import symbol
from .cause import Cause, Constants, Courses, Values, force_cause, of_forms, parameter
from .travel import changing, either_way, periods, viscous_share

if TYPE_CHECKING:
    from ..drive import Drive

_SHARE = "periodic_viscous_share"
_TURNS = (1, 2)  # swings in a turn of the screw


def _form(swings: str, harmonics: tuple[tuple[int, str], ...]) -> Cause:
    def grid(courses: Courses, model: Drive) -> list[Values]:
        return either_way(periods(courses, model, swings, _TURNS), _SHARE)

    amplitudes = {}
    for times, suffix in harmonics:
        angle = 2 * sp.pi * times * symbol(swings) * symbol("x")
        for name, wave in (("cos", sp.cos(angle)), ("sin", sp.sin(angle))):
            told = parameter(
                f"friction_{name}{suffix}", "1", f"share of friction with the {name}ine{suffix}"
            )
            amplitudes[told] = changing(_SHARE, wave)
    return force_cause(
        "position_periodic_friction",
        "friction swings along the travel, as with the turn of the screw",
        amplitudes,
        confirm="move slowly over a few turns both ways: the swing changes sign with the direction",
        mistaken_for=("torque_ripple",),
        constants=Constants(
            (parameter(swings, "1/m", "swings per metre", 1.0), viscous_share(_SHARE)), grid
        ),
        per_record=True,
    )


CAUSE = of_forms(
    _form("periods_per_metre", ((1, ""),)),
    _form("double_periods_per_metre", ((1, "_1"), (2, "_2"))),
)
