"""An amplifier that cannot give the voltage it is asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...instruments.amplifier import clip
from ...solver.component import Component, symbol
from .cause import Cause, Courses, Shape, Values, Vector, of_command, of_forms, parameter

if TYPE_CHECKING:
    from ..drive import Drive
    from ..modelled_record import ModelledRecord

# of the largest command; the last cuts nothing off, as an end for what is sought between them
_LEVELS = np.concatenate(
    [np.geomspace(0.02, 0.36, 12), 1.0 - np.append(np.geomspace(0.6, 0.001, 24), 0.0)]
)

_SAGS = (0.1, 0.3, 1.0)  # resistance of a supply, of the motor's
_SCALES = np.geomspace(0.02, 12.0, 17)  # of the largest command; a bend, not a limit


def _grid(courses: Courses, model: Drive) -> list[Values]:
    del model
    largest = max(float(np.abs(c.u).max()) for c in courses)
    return [{"voltage_limit": float(level)} for level in _LEVELS * largest]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    del model
    level = values["voltage_limit"]
    command = [(np.clip(c.u, -level, level) - c.u)[:, None] for c in courses]
    return Shape(("voltage_limit",), command=command, values=values, sure=0.3)


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return plant  # its limit is another one


def _bent_grid(courses: Courses, model: Drive) -> list[Values]:
    del model
    largest = max(float(np.abs(c.u).max()) for c in courses)
    return [{"voltage_scale": largest * float(k)} for k in _SCALES]


def _bent_at(courses: Courses, model: Drive, values: Values) -> Shape:
    del model
    scale = values["voltage_scale"]
    command = [(scale * np.tanh(c.u / scale) - c.u)[:, None] for c in courses]
    return Shape(("voltage_scale",), command=command, values=values, sure=0.3)


def _bent(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    u, scale = symbol("u"), symbol("voltage_scale")
    given = {u: scale * sp.tanh(u / scale)}
    return plant.substituted(given, parameters=(*plant.parameters, *_BEND.parameters))


def _sagging_grid(courses: Courses, model: Drive) -> list[Values]:
    if not model.has_motor:
        return []
    largest = max(float(np.abs(c.u).max()) for c in courses)
    return [
        {"voltage_limit": float(level), "supply_resistance": share * model.values["R"]}
        for share in _SAGS
        for level in largest * _LEVELS[::3]
    ]


def _sagging_at(courses: Courses, model: Drive, values: Values) -> Shape:
    command = []
    for c in courses:
        most = values["voltage_limit"] - values["supply_resistance"] * _drawn(c, model, values)
        most = np.maximum(most, 0.0)
        command.append((np.clip(c.u, -most, most) - c.u)[:, None])
    return Shape(("voltage_limit",), command=command, values=values, sure=0.3)


def _drawn(course: ModelledRecord, model: Drive, values: Values) -> Vector:
    """Current at the limit, measured or as the limited voltage makes it once settled, (n,) [A]."""
    if course.has_current:
        return np.abs(course.mean_i)
    generated = np.sign(course.u) * model.back_emf * course.middle_v
    resistance = model.values["R"] + values["supply_resistance"]
    return np.maximum((values["voltage_limit"] - generated) / resistance, 0.0)


def _sagging(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    u = symbol("u")
    most = symbol("voltage_limit") - symbol("supply_resistance") * sp.Abs(symbol("i"))
    most = sp.Max(most, 0)
    return plant.substituted({u: clip(u, -most, most)}, parameters=(*plant.parameters, _RESISTANCE))


_RESISTANCE = parameter("supply_resistance", "Ohm", "by which the limit sags with the current")
_CLIP = Cause(
    "voltage_saturation",
    "the amplifier gives less than the largest commands ask for",
    _grid,
    _at,
    (parameter("voltage_limit", "V", "largest voltage, either sign", 1e6),),
    _extend,
    confirm="measure the motor's voltage at the largest command",
    refined=("voltage_limit",),
    mistaken_for=("nonlinear_viscous", "resistance_drift"),
    smaller=of_command,
)
_BEND = replace(
    _CLIP,
    grid=_bent_grid,
    at=_bent_at,
    parameters=(
        parameter("voltage_scale", "V", "voltage that a bent amplifier comes near to", 1e6),
    ),
    extend=_bent,
    refined=("voltage_scale",),
)
_SAG = replace(
    _CLIP,
    grid=_sagging_grid,
    at=_sagging_at,
    parameters=(*_CLIP.parameters, _RESISTANCE),
    extend=_sagging,
)
CAUSE = of_forms(_CLIP, _BEND, _SAG)
