"""An amplifier that cannot give the voltage it is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel

# of the largest command; the last cuts nothing off, as an end for what is sought between them
_LEVELS = 1.0 - np.append(np.geomspace(0.6, 0.001, 24), 0.0)


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del model
    largest = max(float(np.abs(c.u).max()) for c in courses)
    return [{"voltage_limit": float(level)} for level in _LEVELS * largest]


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del model
    level = values["voltage_limit"]
    command = [(np.clip(c.u, -level, level) - c.u)[:, None] for c in courses]
    return Shape(("voltage_limit",), command=command, values=values, sure=0.3)


def _extend(plant: Component, curve: sp.Expr) -> Component:
    del curve
    return plant  # its limit is another one


CAUSE = Cause(
    "voltage_saturation",
    "the amplifier gives less than the largest commands ask for",
    _grid,
    _at,
    (parameter("voltage_limit", "V", "largest voltage, either sign", 1e6),),
    _extend,
    confirm="measure the motor's voltage at the largest command",
    refined="voltage_limit",
    mistaken_for=("nonlinear_viscous", "resistance_drift"),
)
