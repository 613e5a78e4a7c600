"""A motor that warms up: its resistance grows in the course of the record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import TIME, Component, symbol
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del model
    return [{"warming_time": max(float(c.time[-1]) for c in courses)}]


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    r, lasts = model.values["R"], values["warming_time"]
    command = [(-r * c.mean_i * c.time / lasts)[:, None] for c in courses]
    return Shape(("R_drift",), command=command, values=values)


def _extend(plant: Component, curve: sp.Expr) -> Component:
    del curve
    r = symbol("R")
    warm = r * (1 + symbol("R_drift") * TIME / symbol("warming_time"))
    return plant.substituted({r: warm}, parameters=(*plant.parameters, *CAUSE.parameters))


CAUSE = Cause(
    "resistance_drift",
    "the motor's resistance changes in the course of the record",
    _grid,
    _at,
    (
        parameter("R_drift", "1", "share by which the resistance grows in warming_time"),
        parameter("warming_time", "s", "time of that growth", 1.0),
    ),
    _extend,
    confirm="record the current: voltage over current at standstill, before and after",
    mistaken_for=("friction_drift",),
    beyond=lambda courses, model: None if model.has_motor else "the model has no motor",
)
