"""Friction that changes in time, as when a screw warms up, or with a recorded temperature."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ....solver.arrays import Vector
from ....solver.component import symbol
from ..drive import Drive
from ..modelled_record import ModelledRecord
from .cause import FRICTION, Cause, Courses, Mechanism, Values, force, parameter
from .in_time import InTime, in_time
from .travel import changing, either_way, viscous_share

_SHARE = "drift_viscous_share"


def _drifting(how: InTime) -> Mechanism:
    return force(
        {parameter(how.change, "1", "share by which friction grows"): changing(_SHARE, how.course)},
        (how.constant, viscous_share(_SHARE)),
        lambda courses, model: either_way(how.grid(courses, model), _SHARE),
        how.refined,
    )


def _temperature(course: ModelledRecord) -> Vector | None:
    """Recorded temperature at each sample, interpolated if sampled more slowly [degC]."""
    recorded = course.record.signals.get("temperature")
    if recorded is None:
        return None
    known = np.isfinite(recorded)
    return np.interp(course.time, course.time[known], recorded[known])


def _where_recorded(courses: Courses, model: Drive) -> list[Values]:
    warmth = [_temperature(c) for c in courses]
    return [{"warming": 0.0}] if all(t is not None and np.ptp(t) > 0 for t in warmth) else []


def _warming(courses: Courses, model: Drive, values: Values) -> list[Mapping[str, Vector]]:
    warmth = [t for t in map(_temperature, courses) if t is not None]
    mean = float(np.concatenate(warmth).mean())
    return [{"warming": t - mean} for t in warmth]


_WITH_TEMPERATURE = force(
    {
        parameter("friction_per_kelvin", "1/K", "share by which friction grows per degree"): (
            FRICTION * symbol("warming")
        )
    },
    (parameter("warming", "K", "of the screw, above the mean of the records"),),
    _where_recorded,
    signals=_warming,
)
CAUSE = Cause(
    "friction_drift",
    "friction changes during the record",
    (*map(_drifting, in_time("friction", "drift_time")), _WITH_TEMPERATURE),
    confirm="repeat the same motion and record the temperature: friction follows the temperature",
    mistaken_for=("resistance_drift", "position_trend_friction"),
)
