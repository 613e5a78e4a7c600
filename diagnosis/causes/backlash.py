"""A gap between screw and block that every reversal has to cross."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...identification.law_along_record import force_behind_gap
from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, Vector, parameter

if TYPE_CHECKING:
    from ..drive import Drive
    from ..modelled_record import ModelledRecord

_GAPS = 1e-6 * 2.0 ** np.arange(1.0, 10.75, 0.5)  # [m]


def _missing(course: ModelledRecord, model: Drive, gap: float) -> Vector:
    """Force on the screw with the gap, beyond that without."""
    motion = course.x, course.v, course.step
    behind = force_behind_gap(model.law_values, *motion, gap, model.block)
    rigid = course.bristle + model.linear_friction * course.middle_v + model.block * course.mean_a
    return np.asarray(behind - rigid)


def _grid(courses: Courses, model: Drive) -> list[Values]:
    del courses, model
    return [{"gap": float(gap)} for gap in _GAPS]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    force = [_missing(c, model, values["gap"])[:, None] for c in courses]
    return Shape(("gap",), force=force, values=values, sure=0.2)


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.two_masses import with_gap

    return with_gap(plant)


CAUSE = Cause(
    "backlash",
    "the screw turns through a gap before it takes the block along",
    _grid,
    _at,
    (parameter("gap", "m", "between screw and block"),),
    _extend,
    confirm="reverse slowly with the current recorded: it falls to nothing until the gap is closed",
    refined=("gap",),
    mistaken_for=("compliance", "parameter_error", "unexplained"),
)
