"""A friction curve that rises or falls from low speed on where the model's does not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import Component, symbol
from ..modelled_record import with_law_force
from .cause import ENGAGED, Constants, Courses, Shape, Values, force_cause, of_forms, parameter

if TYPE_CHECKING:
    from ..drive import Drive

_SPEEDS = 14
_SMALL = 0.05  # of the friction: a bend so small that its effect is proportional to it
_DEEPEST = 0.9  # of the friction, that a bend may take from it
_BEND = sp.exp(-((symbol("v") / symbol("V_mismatch")) ** 2))

_FALL = sp.exp(-sp.Abs(symbol("v")) / symbol("V_fall"))


def _grid(courses: Courses, model: Drive) -> list[Values]:
    """Characteristic speeds within those of the record."""
    del model
    speeds = np.abs(np.concatenate([c.v for c in courses]))
    high = 0.5 * float(np.quantile(speeds, 0.98))
    low = max(0.03 * high, float(np.quantile(speeds, 0.05)))
    if not high > 1.2 * low:
        return []
    return [{"V_mismatch": float(v)} for v in np.geomspace(low, high, _SPEEDS)]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    if not model.can_bend:
        return _ADDED.at(courses, model, values)
    scale = model.friction_scale
    size = max(values.get("dF_low", 0.0), -_DEEPEST * scale)
    if abs(size) < _SMALL * scale:
        size = _SMALL * scale
    bent = model.changed({**values, "dF_low": size})
    force = [((with_law_force(c, bent).bristle - c.bristle) / size)[:, None] for c in courses]
    return Shape(("dF_low",), force=force, values=values)


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    """The bend goes into the law's curve where it has Stribeck's, else beside the law."""
    names = [p.name for p in plant.all_parameters]
    bent = [n for n in names if n.partition("_")[0] in ("Fc", "Fs")]
    if not any(n.startswith("Fs") for n in bent):
        return _ADDED.extend(plant, curve, values)
    bend = symbol("dF_low") * _BEND
    return plant.substituted(
        {symbol(n): symbol(n) + bend for n in bent},
        parameters=(*plant.parameters, *_ADDED.parameters),
    )


_ADDED = force_cause(
    "stribeck_mismatch",
    "friction at low speed rises or falls otherwise than the model's curve",
    {parameter("dF_low", "N", "friction at low speed beyond the model's"): _BEND * ENGAGED},
    confirm="constant speeds, close together where the curve bends: Table 2.3's experiment",
    mistaken_for=("nonlinear_viscous", "parameter_error"),
    constants=Constants(
        (parameter("V_mismatch", "m/s", "speed by which it has fallen to 1/e", 1.0),),
        _grid,
        refined=("V_mismatch",),
    ),
)

_EXPONENTIAL = force_cause(
    _ADDED.name,
    _ADDED.says,
    {parameter("dF_fall", "N", "friction at low speed beyond the model's"): _FALL * ENGAGED},
    confirm=_ADDED.confirm,
    constants=Constants(
        (parameter("V_fall", "m/s", "speed by which it has fallen to 1/e", 1.0),),
        lambda courses, model: [{"V_fall": v["V_mismatch"]} for v in _grid(courses, model)],
        refined=("V_fall",),
    ),
)

CAUSE = of_forms(replace(_ADDED, at=_at, extend=_extend), _EXPONENTIAL)
