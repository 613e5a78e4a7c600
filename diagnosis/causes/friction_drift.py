"""Friction that changes in time, as a screw does that warms up, or with a recorded temperature."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...solver.component import symbol
from .cause import (
    FRICTION,
    Cause,
    Constants,
    Courses,
    Shape,
    Values,
    Vector,
    force_cause,
    of_forms,
    parameter,
)
from .in_time import InTime, in_time
from .travel import changing, either_way, viscous_share

if TYPE_CHECKING:
    from ..drive import Drive
    from ..modelled_record import ModelledRecord

_SHARE = "drift_viscous_share"
_NAME = "friction_drift"
_SAYS = "friction changes in the course of the record"
_CONFIRM = "the same motion again and again, with a thermometer: friction follows it"


def _form(how: InTime) -> Cause:
    return force_cause(
        _NAME,
        _SAYS,
        {parameter(how.change, "1", "share by which friction grows"): changing(_SHARE, how.course)},
        confirm=_CONFIRM,
        mistaken_for=("resistance_drift", "position_trend_friction"),
        constants=Constants(
            (how.constant, viscous_share(_SHARE)),
            lambda courses, model: either_way(how.grid(courses, model), _SHARE),
            refined=how.refined,
        ),
    )


def _temperature(course: ModelledRecord) -> Vector | None:
    """What a thermometer, perhaps a slower one, shows at each sample [degC]."""
    recorded = course.record.signals.get("temperature")
    if recorded is None:
        return None
    known = np.isfinite(recorded)
    return np.interp(course.time, course.time[known], recorded[known])


def _with_temperature_grid(courses: Courses, model: Drive) -> list[Values]:
    del model
    warmth = [_temperature(c) for c in courses]
    return [{"warming": 0.0}] if all(t is not None and np.ptp(t) > 0 for t in warmth) else []


def _with_temperature_at(courses: Courses, model: Drive, values: Values) -> Shape:
    warmth = [t for t in map(_temperature, courses) if t is not None]
    mean = float(np.concatenate(warmth).mean())
    force = [
        ((c.bristle + model.linear_friction * c.middle_v) * (t - mean))[:, None]
        for c, t in zip(courses, warmth, strict=True)
    ]
    return Shape(("friction_per_kelvin",), force=force, values=values)


_WITH_TEMPERATURE = replace(
    force_cause(
        _NAME,
        _SAYS,
        {
            parameter("friction_per_kelvin", "1/K", "share by which friction grows per degree"): (
                FRICTION * symbol("warming")
            )
        },
        confirm=_CONFIRM,
        constants=Constants(
            (parameter("warming", "K", "of the screw, above the mean of the records"),),
            _with_temperature_grid,
        ),
    ),
    at=_with_temperature_at,
)

CAUSE = of_forms(
    *(_form(how) for how in in_time("friction", "drift_time")),
    _WITH_TEMPERATURE,
)
