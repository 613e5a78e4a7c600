"""Changes during a record: linear, exponential, as a step, or with a recorded temperature.

Of friction, as when a screw warms up, or of the motor's resistance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import sympy as sp

from ....solver.arrays import Vector
from ....solver.component import TIME, Parameter, symbol
from ..model import Drive
from ..motion import Course
from .cause import FRICTION, Cause, Courses, Grid, Mechanism, Values, force, parameter, voltage
from .travel import changing, either_way, viscous_share

# a change that is very fast, or at the very end, is a constant value for nearly the entire record
_SETTLING = (0.15, 0.25, 0.45)  # time constants, as shares of the record
_STEPS = 16  # parts of a record; a step is not in the first two or the last
_SUDDEN = 0.01  # duration of a step [s]


def _longest(courses: Courses) -> float:
    return max(float(c.time[-1]) for c in courses)


def _courses(name: str, line: str, of: Callable[..., Mechanism]) -> tuple[Mechanism, ...]:
    """Mechanisms of a change of `name` whose course in time goes from 0 to 1.

    `of` makes one of the change's name, its course, the constant of the course, and its grid;
    `line` is the constant of the linear course.
    """
    settling, step = f"{name}_settling_time", f"{name}_step_time"
    parts = [k / _STEPS for k in range(2, _STEPS - 1)]

    def grid(constant: str, shares: Sequence[float]) -> Grid:
        return lambda courses, model: [{constant: k * _longest(courses)} for k in shares]

    return (
        of(
            f"{name}_drift",
            TIME / symbol(line),
            parameter(line, "s", "time of that growth", 1.0),
            grid(line, [1.0]),
        ),
        of(
            f"{name}_settling",
            1 - sp.exp(-TIME / symbol(settling)),
            parameter(settling, "s", "time constant of that growth", 1.0),
            grid(settling, _SETTLING),
            settling,
        ),
        of(
            f"{name}_step",
            (1 + sp.tanh((TIME - symbol(step)) / _SUDDEN)) / 2,
            parameter(step, "s", "time of that change", 1.0),
            grid(step, parts),
            step,
        ),
    )


_SHARE = "drift_viscous_share"


def _friction_drifting(
    change: str, course: sp.Expr, constant: Parameter, grid: Grid, refined: str = ""
) -> Mechanism:
    return force(
        {parameter(change, "1", "share by which friction grows"): changing(_SHARE, course)},
        (constant, viscous_share(_SHARE)),
        lambda courses, model: either_way(grid(courses, model), _SHARE),
        refined,
    )


def _temperature(course: Course) -> Vector | None:
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


_PER_KELVIN = parameter("friction_per_kelvin", "1/K", "share by which friction grows per degree")
_WITH_TEMPERATURE = force(
    {_PER_KELVIN: FRICTION * symbol("warming")},
    (parameter("warming", "K", "of the screw, above the mean of the records"),),
    _where_recorded,
    signals=_warming,
)
FRICTION_DRIFT = Cause(
    "friction_drift",
    "friction changes during the record",
    (*_courses("friction", "drift_time", _friction_drifting), _WITH_TEMPERATURE),
    confirm="repeat the same motion and record the temperature: friction follows the temperature",
)


def _resistance_drifting(
    change: str, course: sp.Expr, constant: Parameter, grid: Grid, refined: str = ""
) -> Mechanism:
    return voltage(
        {symbol("R"): symbol("R") * (1 + symbol(change) * course)},
        (parameter(change, "1", "relative increase of the resistance"), constant),
        grid,
        refined,
    )


RESISTANCE_DRIFT = Cause(
    "resistance_drift",
    "the motor's resistance changes during the record",
    _courses("R", "warming_time", _resistance_drifting),
    confirm="record the current: compare voltage over current at standstill, before and after the "
    "run",
    beyond=lambda courses, model: None if model.has_motor else "the model has no motor",
)
