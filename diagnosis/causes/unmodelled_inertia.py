"""Mass that moves with the block and that the model does not have."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel

_LEAST = 0.5  # of what holds a drive back within a window


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del courses, model
    return Shape(("m",), values=values, freed=("m",))


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return plant  # the mass is another one


def _beyond(courses: Courses, model: DriveModel) -> str | None:
    settles = model.inertia / max(model.damping, 1e-12)
    if all(settles < c.step or model.inertia < _LEAST * c.inertia for c in courses):
        return "what is moved is too light for these samples: its speed settles between them"
    return None


CAUSE = Cause(
    "unmodelled_inertia",
    "more mass is moved than the model has",
    lambda courses, model: [{}],
    _at,
    (parameter("m", "kg", "mass of the block", 1.0),),
    _extend,
    confirm="accelerate hard both ways at the same speeds: force over acceleration",
    mistaken_for=("parameter_error", "input_delay"),
    beyond=_beyond,
)
