"""Friction that changes in time, as a screw does that warms up, or with a recorded temperature."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import TIME, Component, symbol
from .cause import FRICTION, Courses, Shape, Values, Vector, force_cause, parameter

if TYPE_CHECKING:
    from ..course import Course
    from ..drive_model import DriveModel


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del model
    found: list[Values] = [{"drift_time": max(float(c.time[-1]) for c in courses)}]
    warmth = [_temperature(c) for c in courses]
    if all(t is not None and np.ptp(t) > 0 for t in warmth):
        found.append({"warming": 0.0})
    return found


def _temperature(course: Course) -> Vector | None:
    """What a thermometer, perhaps a slower one, shows at each sample [degC]."""
    recorded = course.record.signals.get("temperature")
    if recorded is None:
        return None
    known = np.isfinite(recorded)
    return np.interp(course.time, course.time[known], recorded[known])


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    if "warming" not in values:
        return _IN_TIME.at(courses, model, values)
    warmth = [t for t in map(_temperature, courses) if t is not None]
    mean = float(np.concatenate(warmth).mean())
    force = [
        ((c.bristle + model.linear_friction * c.middle_v) * (t - mean))[:, None]
        for c, t in zip(courses, warmth, strict=True)
    ]
    return Shape(("friction_per_kelvin",), force=force, values=values)


def _extend(plant: Component, curve: sp.Expr) -> Component:
    return _WITH_TEMPERATURE.extend(_IN_TIME.extend(plant, curve), curve)


_IN_TIME = force_cause(
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
_WITH_TEMPERATURE = force_cause(
    "friction_with_temperature",
    _IN_TIME.says,
    {
        parameter("friction_per_kelvin", "1/K", "share by which friction grows per degree"): (
            FRICTION * symbol("warming")
        )
    },
    confirm=_IN_TIME.confirm,
    constants=(parameter("warming", "K", "of the screw, above the mean of the records"),),
)

CAUSE = replace(
    _IN_TIME,
    at=_at,
    extend=_extend,
    parameters=(*_IN_TIME.parameters, *_WITH_TEMPERATURE.parameters),
)
