"""A spring between the encoder and where friction acts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..course import Course
    from ..drive_model import DriveModel

_YIELDING = 1e-6 * 2.0 ** np.arange(-4.0, 8.0)  # under the friction of slow sliding [m]


def _missing(course: Course, model: DriveModel, stiffness: float) -> np.ndarray:
    """Force of the law on a block behind the spring, beyond that of one without."""
    behind = model.force_behind_spring(course.x, course.v, course.step, stiffness)
    rigid = course.bristle + model.linear_friction * course.middle_v + model.block * course.mean_a
    return np.asarray(behind - rigid)


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del courses
    stiffest = model.values.get("sigma0", math.inf)  # beyond, bristles of another form do the same
    grid = (model.friction_scale / float(way) for way in _YIELDING)
    return [{"stiffness": k} for k in grid if k < stiffest]


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    force = [_missing(c, model, values["stiffness"])[:, None] for c in courses]
    return Shape(("stiffness",), force=force, values=values, sure=0.3)


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.two_masses import with_spring

    return with_spring(plant)


CAUSE = Cause(
    "compliance",
    "something elastic lies between the encoder and the block",
    _grid,
    _at,
    (parameter("stiffness", "N/m", "of what lies between encoder and block", 1e9),),
    _extend,
    confirm="a sensor on the block beside the encoder: the two part when the force reverses",
    refined=("stiffness",),
    way=lambda model, values: 2.0 * model.friction_scale / values["stiffness"],
    mistaken_for=("parameter_error", "backlash"),
)
