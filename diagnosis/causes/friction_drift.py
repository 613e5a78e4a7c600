"""Friction that changes in time, as a screw does that warms up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...solver.component import TIME, symbol
from .cause import FRICTION, Courses, force_cause, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel


def _grid(courses: Courses, model: DriveModel) -> list[Mapping[str, float]]:
    del model
    return [{"drift_time": max(float(c.time[-1]) for c in courses)}]


CAUSE = force_cause(
    "friction_drift",
    "friction changes in the course of the record",
    {
        parameter("friction_drift", "1", "share by which friction grows in drift_time"): FRICTION
        * TIME
        / symbol("drift_time")
    },
    confirm="the same motion again and again, with a thermometer: friction follows it",
    mistaken_for=("resistance_drift", "position_trend_friction"),
    constants=(parameter("drift_time", "s", "time of that growth", 1.0),),
    grid=_grid,
)
