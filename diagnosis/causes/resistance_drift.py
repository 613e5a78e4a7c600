"""A motor that warms up: its resistance grows in the course of the record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import TIME, Component, symbol
from .cause import Cause, Courses, Shape, Values, of_forms, parameter
from .in_time import InTime, in_time

if TYPE_CHECKING:
    from ..drive import Drive


def _form(how: InTime) -> Cause:
    constant = how.constant.name
    course = sp.lambdify([TIME, symbol(constant)], how.course, "numpy")

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        r = model.values["R"]
        command = [
            (-r * c.mean_i * np.asarray(course(c.time + 0.5 * c.step, values[constant])))[:, None]
            for c in courses
        ]
        return Shape((how.change,), command=command, values=values)

    def extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
        del curve, values
        r = symbol("R")
        warm = r * (1 + symbol(how.change) * how.course)
        return plant.substituted({r: warm}, parameters=(*plant.parameters, *parameters))

    parameters = (
        parameter(how.change, "1", "share by which the resistance grows"),
        how.constant,
    )
    return Cause(
        "resistance_drift",
        "the motor's resistance changes in the course of the record",
        how.grid,
        at,
        parameters,
        extend,
        confirm="record the current: voltage over current at standstill, before and after",
        mistaken_for=("friction_drift",),
        refined=how.refined,
        beyond=lambda courses, model: None if model.has_motor else "the model has no motor",
    )


CAUSE = of_forms(*(_form(how) for how in in_time("R", "warming_time")))
