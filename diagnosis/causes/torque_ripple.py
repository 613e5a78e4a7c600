"""A force that swings with the motor's angle and does not ask for the direction of motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import symbol
from .cause import ACTING, Cause, Constants, Courses, Values, force_cause, of_forms, parameter
from .travel import periods

if TYPE_CHECKING:
    from ..drive import Drive


def _form(
    swings: str, names: str, unit: str, of: sp.Expr, harmonics: tuple[int, ...], tried: range
) -> Cause:
    def grid(courses: Courses, model: Drive) -> list[Values]:
        return periods(courses, model, swings, tried)

    amplitudes = {}
    for times in harmonics:
        angle = 2 * sp.pi * times * symbol(swings) * symbol("x")
        suffix = f"_{times}" if len(harmonics) > 1 else ""
        for name, wave in (("cos", sp.cos(angle)), ("sin", sp.sin(angle))):
            told = parameter(
                f"{names}_{name}{suffix}", unit, f"swing with the {name}ine of the angle"
            )
            amplitudes[told] = of * wave
    return force_cause(
        "torque_ripple",
        "the drive's force swings with the motor's angle, whichever way it turns",
        amplitudes,
        confirm="move slowly over a few turns both ways: the swing keeps its sign",
        mistaken_for=("position_periodic_friction",),
        constants=Constants((parameter(swings, "1/m", "swings per metre", 1.0),), grid),
        per_record=True,
        on_screw=True,
    )


_ONE = sp.Integer(1)
CAUSE = of_forms(
    _form("ripples_per_metre", "ripple", "N", _ONE, (1,), range(1, 9)),
    _form("double_ripples_per_metre", "ripple", "N", _ONE, (1, 2), range(1, 5)),
    _form("constant_ripples_per_metre", "constant_ripple", "1", -ACTING, (1,), range(1, 7)),
)
