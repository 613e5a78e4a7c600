"""Mass that moves with the block and that the model does not have."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..drive import Drive


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    del courses, model
    return Shape(("m",), values=values, freed=("m",))


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return plant  # the mass is another one


CAUSE = Cause(
    "unmodelled_inertia",
    "more mass is moved than the model has",
    lambda courses, model: [{}],
    _at,
    (parameter("m", "kg", "mass of the block", 1.0),),
    _extend,
    confirm="accelerate hard both ways at the same speeds: force over acceleration",
    mistaken_for=("parameter_error", "input_delay"),
)
