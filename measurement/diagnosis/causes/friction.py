"""Forces that depend on speed, direction or time, and a resistance that changes in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from ....plant.lugre import stribeck
from ....solver.arrays import Vector
from ....solver.component import TIME, Component, Parameter, symbol
from ...identification.fitted_law import BRISTLES
from ..model import Drive
from ..motion import Course, with_law_force
from .cause import (
    DRY,
    ENGAGED,
    FRICTION,
    Cause,
    Courses,
    Form,
    Grid,
    Mechanism,
    Values,
    force,
    parameter,
    voltage,
)
from .travel import changing, either_way, fast_speed, viscous_share

_ASYMMETRY_SHARE = "asymmetry_viscous_share"
_ASYMMETRY_SPEED = "V_asymmetry"
_ALIKE = force(
    {
        parameter("asymmetry", "1", "relative increase of friction in +x"): sp.Abs(
            changing(_ASYMMETRY_SHARE, sp.Integer(1))
        )
    },
    (viscous_share(_ASYMMETRY_SHARE),),
    lambda courses, model: either_way([{}], _ASYMMETRY_SHARE),
)
_DRY_AND_VISCOUS = force(
    {
        parameter("dry_asymmetry", "1", "relative increase of dry friction in +x"): sp.Abs(DRY),
        parameter("dF_asymmetry", "N", "by which the viscous one is, at V_asymmetry"): sp.Abs(
            symbol("v")
        )
        / symbol(_ASYMMETRY_SPEED),
    },
    (parameter(_ASYMMETRY_SPEED, "m/s", "speed at which that force is given", 1.0),),
    lambda courses, model: [{_ASYMMETRY_SPEED: fast_speed(courses)}],
)
DIRECTION_ASYMMETRY = Cause(
    "direction_asymmetry",
    "friction is larger in one direction than in the other",
    (_ALIKE, _DRY_AND_VISCOUS),
    confirm="run the same speeds in both directions: the difference is proportional to the "
    "friction",
    entry="force of one sign",
)
LOAD_BIAS = Cause(
    "load_bias",
    "a constant force acts on the block",
    (force({parameter("load", "N", "constant force against motion in +x"): sp.Integer(1)}),),
    confirm="measure the force that just moves the block in both directions: the two differ, by "
    "the same amount at all speeds",
    entry="force of one sign",
)

_V = symbol("v")
_SLOWEST = sp.Float("1e-5")  # below this speed a root is replaced by a line [m/s]
_POWERS = (0.5, 1.5, 3.0)

_QUADRATIC = force(
    {parameter("sigma3", "N*s^2/m^2", "quadratic viscous coefficient"): _V * sp.Abs(_V)}
)
_POWER = force(
    {
        parameter("F_power", "N", "friction at viscous_speed minus that of the model"): _V
        / symbol("viscous_speed")
        * (sp.sqrt(_V**2 + _SLOWEST**2) / symbol("viscous_speed")) ** (symbol("viscous_power") - 1)
    },
    (
        parameter("viscous_power", "1", "power of the speed", 1.0),
        parameter("viscous_speed", "m/s", "speed at which the force is given", 1.0),
    ),
    lambda courses, model: [
        {"viscous_power": power, "viscous_speed": fast_speed(courses)} for power in _POWERS
    ],
)
NONLINEAR_VISCOUS = Cause(
    "nonlinear_viscous",
    "friction at high speed is not proportional to the speed",
    (_QUADRATIC, _POWER),
    confirm="constant speeds up to the highest: friction over speed is not a straight line",
)

_SPEEDS = 14
_SMALL = 0.05  # bend, as a share of friction, whose effect is still proportional to it
_DEEPEST = 0.9  # largest decrease by a bend, as a share of friction
_BEYOND = "friction at low speed minus that of the model"
_FALLEN = "speed by which it has fallen to 1/e"
# the Stribeck curve from one to zero, as in the law along a record
_BEND = stribeck(symbol("v")).xreplace(
    {symbol("Fc"): sp.Integer(0), symbol("Fs"): sp.Integer(1), symbol("Vs"): symbol("V_mismatch")}
)


def _speeds(courses: Courses) -> list[float]:
    """Characteristic speeds within the range of the record."""
    speeds = np.abs(np.concatenate([c.v for c in courses]))
    high = 0.5 * float(np.quantile(speeds, 0.98))
    low = max(0.03 * high, float(np.quantile(speeds, 0.05)))
    return [float(v) for v in np.geomspace(low, high, _SPEEDS)] if high > 1.2 * low else []


def _at(courses: Courses, model: Drive, values: Values) -> Form:
    if model.law not in BRISTLES:
        return _ADDED.at(courses, model, values)
    scale = model.friction_scale
    size = max(values.get("dF_low", 0.0), -_DEEPEST * scale)
    if abs(size) < _SMALL * scale:
        size = _SMALL * scale
    bent = model.changed({**values, "dF_low": size})
    forces = [((with_law_force(c, bent).bristle - c.bristle) / size)[:, None] for c in courses]
    return Form(("dF_low",), force=forces, values=values)


def _extend(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
    """Add the bend to the law's Stribeck curve if it has one, otherwise to the law's force."""
    names = [p.name for p in plant.all_parameters]
    bent = [n for n in names if n.partition("_")[0] in ("Fc", "Fs")]
    if not any(n.startswith("Fs") for n in bent):
        return _ADDED.extend(plant, curve, cause)
    bend = symbol("dF_low") * _BEND
    return plant.substituted(
        {symbol(n): symbol(n) + bend for n in bent},
        parameters=(*plant.parameters, *_ADDED.parameters),
    )


_ADDED = force(
    {parameter("dF_low", "N", _BEYOND): _BEND * ENGAGED},
    (parameter("V_mismatch", "m/s", _FALLEN, 1.0),),
    lambda courses, model: [{"V_mismatch": v} for v in _speeds(courses)],
    "V_mismatch",
)
STRIBECK_MISMATCH = Cause(
    "stribeck_mismatch",
    "friction at low speed has another curve than that of the model",
    (replace(_ADDED, at=_at, extend=_extend),),
    confirm="constant speeds, closely spaced where the curve changes: the experiment of Table 2.3",
)


# -- changes in time: linear, exponential, as a step, or with a recorded temperature -----------

# a change that is very fast, or at the very end, is a constant value for nearly the entire record
_SETTLING = (0.15, 0.25, 0.45)  # time constants, as shares of the record
_STEPS = 16  # parts of a record; a step is not in the first two or the last
_SUDDEN = 0.01  # duration of a step [s]


def _courses(name: str, line: str, of: Callable[..., Mechanism]) -> tuple[Mechanism, ...]:
    """Mechanisms of a change of `name` whose course in time goes from 0 to 1.

    `of` makes one of the change's name, its course, the constant of the course, and its grid;
    `line` is the constant of the linear course.
    """

    def one(change: str, constant: str, says: str, course: sp.Expr, shares: Vector) -> Mechanism:
        def grid(courses: Courses, model: Drive) -> list[Values]:
            longest = max(float(c.time[-1]) for c in courses)
            return [{constant: float(k) * longest} for k in shares]

        refined = "" if constant == line else constant
        return of(f"{name}_{change}", course, parameter(constant, "s", says, 1.0), grid, refined)

    settling, step = f"{name}_settling_time", f"{name}_step_time"
    settles = 1 - sp.exp(-TIME / symbol(settling))
    steps = (1 + sp.tanh((TIME - symbol(step)) / _SUDDEN)) / 2
    parts = np.arange(2, _STEPS - 1) / _STEPS
    return (
        one("drift", line, "time of that growth", TIME / symbol(line), np.ones(1)),
        one("settling", settling, "time constant of that growth", settles, np.array(_SETTLING)),
        one("step", step, "time of that change", steps, parts),
    )


_SHARE = "drift_viscous_share"


def _friction_drifting(
    change: str, course: sp.Expr, constant: Parameter, grid: Grid, refined: str
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
    change: str, course: sp.Expr, constant: Parameter, grid: Grid, refined: str
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
