"""Friction that changes along the travel: a bent screw, a bow, an end that is worn."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import Parameter, symbol
from .cause import Constants, Courses, Values, force_cause, of_forms, parameter
from .travel import changing, either_way, middle_and_half, viscous_share

if TYPE_CHECKING:
    from ..drive import Drive

_SHARE = "trend_viscous_share"
_WORN_FROM = (-0.4, 0.0, 0.4)  # of half the travel


def _place(middle: str, half: str) -> sp.Expr:
    return (symbol("x") - symbol(middle)) / symbol(half)


def _whole(middle: str, half: str) -> Callable[[Courses, Drive], list[Values]]:
    def grid(courses: Courses, model: Drive) -> list[Values]:
        del model
        return either_way(
            [dict(zip((middle, half), middle_and_half(courses), strict=True))], _SHARE
        )

    return grid


def _ends(courses: Courses, model: Drive) -> list[Values]:
    del model
    middle, half = middle_and_half(courses)
    worn: list[Values] = [
        {"x_worn": middle + k * half, "way_worn": way * (1 - way * k) * half}
        for k in _WORN_FROM
        for way in (1.0, -1.0)
    ]
    return either_way(worn, _SHARE)


def _constants(middle: str, half: str) -> tuple[Parameter, ...]:
    return (
        parameter(middle, "m", "middle of the travel"),
        parameter(half, "m", "half the travel", 1.0),
        viscous_share(_SHARE),
    )


_BEYOND = "share of friction at the travel's end beyond its middle"
_SLOPE = force_cause(
    "position_trend_friction",
    "friction changes from one end of the travel to the other",
    {
        parameter("friction_trend", "1", _BEYOND): changing(_SHARE, _place("x_middle", "x_half")),
    },
    confirm="slow runs over the whole travel both ways: the width between them changes along it",
    mistaken_for=("friction_drift", "unexplained"),
    constants=Constants(_constants("x_middle", "x_half"), _whole("x_middle", "x_half")),
)
_BOW = force_cause(
    _SLOPE.name,
    _SLOPE.says,
    {
        parameter("friction_slope", "1", _BEYOND): changing(_SHARE, _place("x_bow", "bow_half")),
        parameter("friction_bow", "1", "share of friction at both ends beyond the middle"): (
            changing(_SHARE, _place("x_bow", "bow_half") ** 2)
        ),
    },
    confirm=_SLOPE.confirm,
    constants=Constants(_constants("x_bow", "bow_half"), _whole("x_bow", "bow_half")),
)
_INTO = (symbol("x") - symbol("x_worn")) / symbol("way_worn")
_END = force_cause(
    _SLOPE.name,
    _SLOPE.says,
    {
        parameter("friction_worn", "1", "share of friction at the worn end beyond the rest"): (
            changing(_SHARE, (_INTO + sp.Abs(_INTO)) / 2)
        )
    },
    confirm=_SLOPE.confirm,
    constants=Constants(
        (
            parameter("x_worn", "m", "where the worn part begins"),
            parameter("way_worn", "m", "from there to the end, negative to -x", 1.0),
            viscous_share(_SHARE),
        ),
        _ends,
    ),
)
CAUSE = of_forms(_SLOPE, _BOW, _END)
