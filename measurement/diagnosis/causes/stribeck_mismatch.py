"""A friction curve that rises or falls at low speed, unlike that of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from ....plant.lugre import stribeck
from ....solver.component import Component, symbol
from ..drive import Drive
from ..modelled_record import with_law_force
from .cause import ENGAGED, Cause, Courses, Shape, Values, force, parameter

_SPEEDS = 14
_SMALL = 0.05  # bend, as a share of friction, whose effect is still proportional to it
_DEEPEST = 0.9  # largest decrease by a bend, as a share of friction
_BEYOND = "friction at low speed minus that of the model"
_FALLEN = "speed by which it has fallen to 1/e"
# the Stribeck curve from one to zero, as in the law along a record
_BEND = stribeck(symbol("v")).xreplace(
    {symbol("Fc"): sp.Integer(0), symbol("Fs"): sp.Integer(1), symbol("Vs"): symbol("V_mismatch")}
)
_FALL = sp.exp(-sp.Abs(symbol("v")) / symbol("V_fall"))


def _speeds(courses: Courses) -> list[float]:
    """Characteristic speeds within the range of the record."""
    speeds = np.abs(np.concatenate([c.v for c in courses]))
    high = 0.5 * float(np.quantile(speeds, 0.98))
    low = max(0.03 * high, float(np.quantile(speeds, 0.05)))
    return [float(v) for v in np.geomspace(low, high, _SPEEDS)] if high > 1.2 * low else []


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    if not model.can_bend:
        return _ADDED.at(courses, model, values)
    scale = model.friction_scale
    size = max(values.get("dF_low", 0.0), -_DEEPEST * scale)
    if abs(size) < _SMALL * scale:
        size = _SMALL * scale
    bent = model.changed({**values, "dF_low": size})
    forces = [((with_law_force(c, bent).bristle - c.bristle) / size)[:, None] for c in courses]
    return Shape(("dF_low",), force=forces, values=values)


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
_EXPONENTIAL = force(
    {parameter("dF_fall", "N", _BEYOND): _FALL * ENGAGED},
    (parameter("V_fall", "m/s", _FALLEN, 1.0),),
    lambda courses, model: [{"V_fall": v} for v in _speeds(courses)],
    "V_fall",
)
CAUSE = Cause(
    "stribeck_mismatch",
    "friction at low speed has another curve than that of the model",
    (replace(_ADDED, at=_at, extend=_extend), _EXPONENTIAL),
    confirm="constant speeds, closely spaced where the curve changes: the experiment of Table 2.3",
    mistaken_for=("nonlinear_viscous", "parameter_error"),
)
