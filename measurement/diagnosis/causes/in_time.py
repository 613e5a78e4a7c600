"""Changes during a record: linear, exponential, or as a step."""

from __future__ import annotations

from typing import NamedTuple

import sympy as sp

from ....solver.component import TIME, Parameter, symbol
from .cause import Courses, Grid, parameter

# a change that is very fast, or at the very end, is a constant value for nearly the entire record
_SETTLING = (0.15, 0.25, 0.45)  # time constants, as shares of the record
_STEPS = 16  # parts of a record; a step is not in the first two or the last
_SUDDEN = 0.01  # duration of a step [s]


class InTime(NamedTuple):
    """A named change; its course in time goes from 0 to 1.

    The course has one constant; see `Mechanism` for `grid` and `refined`.
    """

    change: str
    course: sp.Expr
    constant: Parameter
    grid: Grid
    refined: str = ""


def _longest(courses: Courses) -> float:
    return max(float(c.time[-1]) for c in courses)


def in_time(name: str, line: str) -> tuple[InTime, ...]:
    """The courses of a change of `name`; `line` is the constant of the linear one."""
    settling, step = f"{name}_settling_time", f"{name}_step_time"
    parts = [k / _STEPS for k in range(2, _STEPS - 1)]
    return (
        InTime(
            f"{name}_drift",
            TIME / symbol(line),
            parameter(line, "s", "time of that growth", 1.0),
            lambda courses, model: [{line: _longest(courses)}],
        ),
        InTime(
            f"{name}_settling",
            1 - sp.exp(-TIME / symbol(settling)),
            parameter(settling, "s", "time constant of that growth", 1.0),
            lambda courses, model: [{settling: k * _longest(courses)} for k in _SETTLING],
            settling,
        ),
        InTime(
            f"{name}_step",
            (1 + sp.tanh((TIME - symbol(step)) / _SUDDEN)) / 2,
            parameter(step, "s", "time of that change", 1.0),
            lambda courses, model: [{step: k * _longest(courses)} for k in parts],
            step,
        ),
    )
