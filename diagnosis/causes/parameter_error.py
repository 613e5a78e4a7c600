"""Nothing is missing: a value of the model is wrong by more than it was believed to be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values

if TYPE_CHECKING:
    from ..drive_model import DriveModel


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del courses
    return [{name: value} for name, value in model.values.items() if _may_be(name, model)]


def _may_be(name: str, model: DriveModel) -> bool:
    return name in model.adjustable and name not in ("m", "Jm")  # these are inertia


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del courses, model
    (name,) = values
    return Shape((name,), freed=name)


def _extend(plant: Component, curve: sp.Expr) -> Component:
    del curve
    return plant  # its values are others


CAUSE = Cause(
    "parameter_error",
    "a value of the model is wrong",
    _grid,
    _at,
    (),
    _extend,
    confirm="measure that value by itself",
    mistaken_for=("unmodelled_inertia", "compliance", "stribeck_mismatch"),
)
