"""Friction that changes along the travel: a misaligned or bowed screw, a worn end."""

from __future__ import annotations

import sympy as sp

from ....solver.component import symbol
from ..drive import Drive
from .cause import Cause, Courses, Mechanism, Values, force, parameter
from .travel import changing, either_way, middle_and_half, viscous_share

_SHARE = "trend_viscous_share"
_WORN_FROM = (-0.4, 0.0, 0.4)  # start of the worn end, over half the travel
_BEYOND = "friction at the end of the travel minus that in its middle, as a share"
_AT_BOTH = "friction at both ends minus that in the middle, as a share"


def _over_travel(middle: str, half: str, amplitudes: dict[tuple[str, str], int]) -> Mechanism:
    """Friction by powers of the position from the middle of the travel; by name and meaning."""
    place = (symbol("x") - symbol(middle)) / symbol(half)
    return force(
        {
            parameter(name, "1", meaning): changing(_SHARE, place**power)
            for (name, meaning), power in amplitudes.items()
        },
        (
            parameter(middle, "m", "middle of the travel"),
            parameter(half, "m", "half the travel", 1.0),
            viscous_share(_SHARE),
        ),
        lambda courses, model: either_way(
            [dict(zip((middle, half), middle_and_half(courses), strict=True))], _SHARE
        ),
    )


def _ends(courses: Courses, model: Drive) -> list[Values]:
    middle, half = middle_and_half(courses)
    worn: list[Values] = [
        {"x_worn": middle + k * half, "way_worn": way * (1 - way * k) * half}
        for k in _WORN_FROM
        for way in (1.0, -1.0)
    ]
    return either_way(worn, _SHARE)


_INTO = (symbol("x") - symbol("x_worn")) / symbol("way_worn")
_END = force(
    {
        parameter("friction_worn", "1", "additional friction at the worn end, as a share"): (
            changing(_SHARE, (_INTO + sp.Abs(_INTO)) / 2)
        )
    },
    (
        parameter("x_worn", "m", "where the worn part begins"),
        parameter("way_worn", "m", "length from there to the end; negative: towards -x", 1.0),
        viscous_share(_SHARE),
    ),
    _ends,
)
CAUSE = Cause(
    "position_trend_friction",
    "friction changes from one end of the travel to the other",
    (
        _over_travel("x_middle", "x_half", {("friction_trend", _BEYOND): 1}),
        _over_travel(
            "x_bow",
            "bow_half",
            {("friction_slope", _BEYOND): 1, ("friction_bow", _AT_BOTH): 2},
        ),
        _END,
    ),
    confirm="slow runs over the whole travel in both directions: the difference of the forces "
    "changes along the travel",
    mistaken_for=("friction_drift", "unexplained"),
)
