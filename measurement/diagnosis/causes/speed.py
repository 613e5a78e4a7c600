"""Forces that depend on speed and direction: asymmetry, load, viscous friction, low speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from ....plant.lugre import stribeck
from ....solver.component import Component, symbol
from ...identification.fitted_law import BRISTLES
from ..model import Drive
from ..motion import with_law_force
from .cause import DRY, ENGAGED, Cause, Courses, Form, Values, force, parameter
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
