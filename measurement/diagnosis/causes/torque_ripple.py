"""A force that oscillates with the motor's angle, independent of the direction of motion."""

from __future__ import annotations

import sympy as sp

from .cause import ACTING, Cause, Mechanism, force, parameter
from .travel import periods, waves


def _swinging(
    per_metre: str, names: str, unit: str, of: sp.Expr, harmonics: tuple[int, ...], tried: range
) -> Mechanism:
    return force(
        {
            parameter(f"{names}_{wave.name}", unit, f"swing with the {wave.kind} of the angle"): of
            * wave.course
            for wave in waves(per_metre, harmonics)
        },
        (parameter(per_metre, "1/m", "periods per metre", 1.0),),
        lambda courses, model: periods(courses, model, per_metre, tried),
        per_record=True,
    )


_ONE = sp.Integer(1)
CAUSE = Cause(
    "torque_ripple",
    "the drive's force varies periodically with the motor's angle, the same in both directions",
    (
        _swinging("ripples_per_metre", "ripple", "N", _ONE, (1,), range(1, 9)),
        _swinging("double_ripples_per_metre", "ripple", "N", _ONE, (1, 2), range(1, 5)),
        _swinging("constant_ripples_per_metre", "constant_ripple", "1", -ACTING, (1,), range(1, 7)),
    ),
    confirm="move slowly over a few turns in both directions: the periodic part keeps its sign",
    mistaken_for=("position_periodic_friction",),
)
