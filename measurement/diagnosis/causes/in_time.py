"""Changes during a record: linear, exponential, as a step, or with a recorded temperature.

Of friction, as when a screw warms up, or of the motor's resistance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import sympy as sp

from ....solver.arrays import Vector
from ....solver.component import TIME, Parameter, symbol
from ..drive import Drive
from ..modelled_record import ModelledRecord
from .cause import FRICTION, Cause, Courses, Grid, Mechanism, Values, force, parameter, voltage
from .travel import changing, either_way, viscous_share

# a change that is very fast, or at the very end, is a constant value for nearly the entire record
_SETTLING = (0.15, 0.25, 0.45)  # time constants, as shares of the record
_STEPS = 16  # parts of a record; a step is not in the first two or the last
_SUDDEN = 0.01  # duration of a step [s]


class InTime(NamedTuple):
    """A named change; its course in time goes from 0 to 1.

    The course has one constant; see `Mechanism` for `grid` and `refined`.
    """

    change: str
    course: sp.Expr
    constant: Parameter
    grid: Grid
    refined: str = ""


def _longest(courses: Courses) -> float:
    return max(float(c.time[-1]) for c in courses)


def in_time(name: str, line: str) -> tuple[InTime, ...]:
    """The courses of a change of `name`; `line` is the constant of the linear one."""
    settling, step = f"{name}_settling_time", f"{name}_step_time"
    parts = [k / _STEPS for k in range(2, _STEPS - 1)]
    return (
        InTime(
            f"{name}_drift",
            TIME / symbol(line),
            parameter(line, "s", "time of that growth", 1.0),
            lambda courses, model: [{line: _longest(courses)}],
        ),
        InTime(
            f"{name}_settling",
            1 - sp.exp(-TIME / symbol(settling)),
            parameter(settling, "s", "time constant of that growth", 1.0),
            lambda courses, model: [{settling: k * _longest(courses)} for k in _SETTLING],
            settling,
        ),
        InTime(
            f"{name}_step",
            (1 + sp.tanh((TIME - symbol(step)) / _SUDDEN)) / 2,
            parameter(step, "s", "time of that change", 1.0),
            lambda courses, model: [{step: k * _longest(courses)} for k in parts],
            step,
        ),
    )


_SHARE = "drift_viscous_share"


def _friction_drifting(how: InTime) -> Mechanism:
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
FRICTION_DRIFT = Cause(
    "friction_drift",
    "friction changes during the record",
    (*map(_friction_drifting, in_time("friction", "drift_time")), _WITH_TEMPERATURE),
    confirm="repeat the same motion and record the temperature: friction follows the temperature",
)


_R = symbol("R")


def _resistance_drifting(how: InTime) -> Mechanism:
    return voltage(
        {_R: _R * (1 + symbol(how.change) * how.course)},
        (parameter(how.change, "1", "relative increase of the resistance"), how.constant),
        how.grid,
        how.refined,
    )


RESISTANCE_DRIFT = Cause(
    "resistance_drift",
    "the motor's resistance changes during the record",
    tuple(map(_resistance_drifting, in_time("R", "warming_time"))),
    confirm="record the current: compare voltage over current at standstill, before and after the "
    "run",
    beyond=lambda courses, model: None if model.has_motor else "the model has no motor",
)
