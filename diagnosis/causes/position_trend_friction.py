"""Friction that grows along the travel, as from a screw that is bent or badly aligned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...solver.component import symbol
from .cause import Courses, force_cause, parameter
from .travel import changing, either_way, middle_and_half, viscous_share

if TYPE_CHECKING:
    from ..drive_model import DriveModel

_SHARE = "trend_viscous_share"


def _grid(courses: Courses, model: DriveModel) -> list[Mapping[str, float]]:
    del model
    middle, half = middle_and_half(courses)
    return either_way([{"x_middle": middle, "x_half": half}], _SHARE)


CAUSE = force_cause(
    "position_trend_friction",
    "friction grows from one end of the travel to the other",
    {
        parameter(
            "friction_trend", "1", "share of friction at the travel's end beyond its middle"
        ): changing(_SHARE) * (symbol("x") - symbol("x_middle")) / symbol("x_half")
    },
    confirm="slow runs over the whole travel both ways: the width between them changes along it",
    mistaken_for=("friction_drift", "unexplained"),
    constants=(
        parameter("x_middle", "m", "middle of the travel"),
        parameter("x_half", "m", "half the travel", 1.0),
        viscous_share(_SHARE),
    ),
    grid=_grid,
)
