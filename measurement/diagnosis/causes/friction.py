"""Forces that depend on speed, direction or time, and what acts after a reversal.

The latter are bristles, or a gap or a spring between encoder and block. The plant has the two as a
force between two bodies, see `two_masses`. Along a record, the motion of the encoder's side is
given, and compiled code integrates that of the block with steps that are stable for any stiffness.
The friction of the block has its own states, so its motion is not a closed expression.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from ....plant.lugre import stribeck
from ....plant.two_masses import GAP, STIFFNESS, with_gap, with_spring
from ....solver.arrays import Vector
from ....solver.component import TIME, Component, Parameter, symbol
from ...identification.fitted_law import assumed_damping, fitted_law
from ...identification.law_along_record import SHARPNESS, force_behind
from ..model import SLOWEST, SPREAD, TOLERANCE, WIDEST, Drive
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
    of_friction,
    parameter,
    voltage,
)
from .travel import fast_speed

_V = symbol("v")
_ASYMMETRY_SPEED = "V_asymmetry"
_ALIKE = of_friction(
    "asymmetry_viscous_share",
    {parameter("asymmetry", "1", "relative increase of friction in +x"): sp.Integer(1)},
    one_way=True,
)
_DRY_AND_VISCOUS = force(
    {
        parameter("dry_asymmetry", "1", "relative increase of dry friction in +x"): sp.Abs(DRY),
        parameter("dF_asymmetry", "N", "by which the viscous one is, at V_asymmetry"): sp.Abs(_V)
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

_POWERS = (0.5, 1.5)  # below and above one; others are found between and beyond

_SIGMA3 = parameter("sigma3", "N*s^2/m^2", "quadratic viscous coefficient")
_AT_SPEED = parameter("F_power", "N", "friction at viscous_speed minus that of the model")
_EXPONENT = parameter("viscous_power", "1", "power of the speed", 1.0)
_SPEED = parameter("viscous_speed", "m/s", "speed at which the force is given", 1.0)
_PACE = sp.sqrt(_V**2 + SLOWEST**2) / symbol(_SPEED.name)


def _powers(courses: Courses, model: Drive) -> list[Values]:
    fast = fast_speed(courses)
    return [{_EXPONENT.name: power, _SPEED.name: fast} for power in _POWERS]


_SHAPE = _V / symbol(_SPEED.name) * _PACE ** (symbol(_EXPONENT.name) - 1)
_OF_POWER = force({_AT_SPEED: _SHAPE}, (_EXPONENT, _SPEED), _powers, _EXPONENT.name)
NONLINEAR_VISCOUS = Cause(
    "nonlinear_viscous",
    "friction at high speed is not proportional to the speed",
    (force({_SIGMA3: _V * sp.Abs(_V)}), _OF_POWER),
    confirm="constant speeds up to the highest: friction over speed is not a straight line",
)

# the Stribeck curve from one to zero, as in the law along a record
_BEND = stribeck(symbol("v")).xreplace(
    {symbol("Fc"): sp.Integer(0), symbol("Fs"): sp.Integer(1), symbol("Vs"): symbol("V_mismatch")}
)


def _speeds(courses: Courses) -> list[float]:
    """Characteristic speeds within the range of the record, an octave apart or less."""
    speeds = np.abs(np.concatenate([c.v for c in courses]))
    high = 0.5 * float(np.quantile(speeds, 0.98))
    low = max(0.03 * high, float(np.quantile(speeds, 0.05)))
    if high <= low:
        return []
    octaves = math.ceil(math.log2(high / low))
    return [float(v) for v in np.geomspace(low, high, octaves + 1)]


def _bend(courses: Courses, model: Drive, values: Values) -> Form:
    if fitted_law(model.law).form != "bristles":
        return _ADDED.at(courses, model, values)
    scale = model.friction_scale
    size = max(values.get("dF_low", 0.0), -WIDEST * scale)
    if abs(size) < TOLERANCE * scale:  # the effect is still proportional to such a small bend
        size = TOLERANCE * scale
    bent = model.changed({**values, "dF_low": size})
    forces = [((with_law_force(c, bent).bristle - c.bristle) / size)[:, None] for c in courses]
    return Form(("dF_low",), force=forces, values=values)


def _bent_plant(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
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
    {parameter("dF_low", "N", "friction at low speed minus that of the model"): _BEND * ENGAGED},
    (parameter("V_mismatch", "m/s", "speed by which it has fallen to 1/e", 1.0),),
    lambda courses, model: [{"V_mismatch": v} for v in _speeds(courses)],
    "V_mismatch",
)
STRIBECK_MISMATCH = Cause(
    "stribeck_mismatch",
    "friction at low speed has another curve than that of the model",
    (replace(_ADDED, at=_bend, extend=_bent_plant),),
    confirm="constant speeds, closely spaced where the curve changes: the experiment of Table 2.3",
)


# -- changes in time: linear, exponential, as a step, or with a recorded temperature -----------

_SHARES = 2.0 ** -np.arange(0.5, 3.5, 0.5)  # of a record: times to try of a step or a settling
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
    return (
        one("drift", line, "time of that growth", TIME / symbol(line), np.ones(1)),
        one("settling", settling, "time constant of that growth", settles, _SHARES),
        one("step", step, "time of that change", steps, _SHARES),
    )


def _friction_drifting(
    change: str, course: sp.Expr, constant: Parameter, grid: Grid, refined: str
) -> Mechanism:
    grows = parameter(change, "1", "share by which friction grows")
    return of_friction("drift_viscous_share", {grows: course}, (constant,), grid, refined)


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


# -- after a reversal --------------------------------------------------------------------------


def joint(
    kind: str, varied: Parameter, build: Callable[[Component], Component], grid: Grid
) -> Mechanism:
    """A joint with one parameter; `kind` as in `force_behind`."""

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        size, block, forces = values[varied.name], model.linear.block, []
        for c in courses:
            behind = force_behind(kind, model.law_values, c.x, c.v, c.step, size, block)
            rigid = c.bristle + model.linear_friction * c.middle_v + block * c.mean_a
            forces.append((behind - rigid)[:, None])
        return Form((varied.name,), force=forces, values=values, sure=SPREAD)

    return Mechanism((varied,), at, grid, lambda plant, curve, cause: build(plant), varied.name)


_GAPS = 1e-6 * 2.0 ** np.arange(1.0, 10.75, 0.5)  # [m]


def _gap_grid(courses: Courses, model: Drive) -> list[Values]:
    return [{GAP.name: float(gap)} for gap in _GAPS]


BACKLASH = Cause(
    "backlash",
    "backlash: at each reversal the screw turns through a gap before it moves the block",
    (joint("gap", GAP, with_gap, _gap_grid),),
    confirm="reverse slowly and record the current: it is near zero until the gap is closed",
)


_YIELDING = 1e-6 * 2.0 ** np.arange(-4.0, 8.0)  # deflection under the friction of slow sliding [m]


def _spring_grid(courses: Courses, model: Drive) -> list[Values]:
    stiffest = model.values.get("sigma0", math.inf)  # a stiffer spring acts like bristles
    grid = (model.friction_scale / float(way) for way in _YIELDING)
    return [{STIFFNESS.name: k} for k in grid if k < stiffest]


COMPLIANCE = Cause(
    "compliance",
    "something elastic lies between the encoder and the block",
    (joint("spring", STIFFNESS, with_spring, _spring_grid),),
    confirm="a sensor on the block in addition to the encoder: their readings differ when the "
    "force reverses",
    entry="softer at reversal",
)


PRESLIDING = "presliding_hysteresis"
_WAYS = 1e-6 * 2.0 ** np.arange(0.0, 9.5, 0.5)  # presliding distances [m]


def bristled(model: Drive, sigma0: float, damping_ratio: float = 1.0) -> Drive:
    """The model with LuGre bristles and its own curve over speed, see `damping_ratio`."""
    sigma1 = assumed_damping(sigma0, model.values["sigma2"], model.linear.block, damping_ratio)
    values = {**model.values, "sigma0": sigma0, "sigma1": max(sigma1, 0.0), "Kv": SHARPNESS}
    return replace(model, law="modified_lugre", values=values)


def _stiffnesses(courses: Courses, model: Drive) -> list[Values]:
    return [{"sigma0": model.friction_scale / float(way)} for way in _WAYS]


def _undamped(courses: Courses, model: Drive) -> list[Values]:
    return [{**v, "damping_ratio": 0.0} for v in _stiffnesses(courses, model)]


def _bristles(courses: Courses, model: Drive, values: Values) -> Form:
    bent = bristled(model, **values)
    forces = [(with_law_force(c, bent).bristle - c.bristle)[:, None] for c in courses]
    return Form(("sigma0",), force=forces, values=values, sure=SPREAD)


def _has_bristles(courses: Courses, model: Drive) -> str | None:
    return None if model.law == "classical" else "the prior law is not the classical one"


_STIFFNESS = parameter("sigma0", "N/m", "stiffness of the bristles", 1e6)
_RATIO = parameter("damping_ratio", "1", "damping of the bristles, share of the critical one", 1.0)
PRESLIDING_HYSTERESIS = Cause(
    PRESLIDING,
    "presliding: after each reversal the force rises over a distance, which the law does not "
    "describe",
    (
        Mechanism((_STIFFNESS,), _bristles, _stiffnesses, refined="sigma0"),
        Mechanism((_STIFFNESS, _RATIO), _bristles, _undamped, refined="sigma0"),
    ),
    confirm="small slow movements forwards and backwards: force over position is a hysteresis loop",
    beyond=_has_bristles,
    entry="softer at reversal",
)
