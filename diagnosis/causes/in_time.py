"""How something changes in the course of a record: along a line, settling, or at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import TIME, Parameter, symbol
from .cause import Courses, Values, parameter

if TYPE_CHECKING:
    from ..drive import Drive

# what is over at once, or comes at the very end, is another constant value for nearly all the time
_SETTLING = (0.15, 0.25, 0.45)  # of the record
_STEPS = 16  # parts of a record; a step is not in the first two or the last
_SUDDEN = 0.01  # of a step [s]


@dataclass(frozen=True)
class InTime:
    """One course of a change that is 0 at first and 1 when all of it has come.

    Attributes
    ----------
    change : str
        What the change is called.
    course : expression of the time and `constant`
    constant : Parameter
    grid : function of (courses, model) to a list of mappings
    refined : tuple of str
    """

    change: str
    course: sp.Expr
    constant: Parameter
    grid: Callable[[Courses, Drive], list[Values]]
    refined: tuple[str, ...]


def in_time(name: str, line: str) -> tuple[InTime, ...]:
    """The courses of a change of `name`; `line` is the constant of the straight one."""
    settling, step = f"{name}_settling_time", f"{name}_step_time"

    def longest(courses: Courses) -> float:
        return max(float(c.time[-1]) for c in courses)

    return (
        InTime(
            f"{name}_drift",
            TIME / symbol(line),
            parameter(line, "s", "time of that growth", 1.0),
            lambda courses, model: [{line: longest(courses)}],
            (),
        ),
        InTime(
            f"{name}_settling",
            1 - sp.exp(-TIME / symbol(settling)),
            parameter(settling, "s", "time constant of that growth", 1.0),
            lambda courses, model: [{settling: k * longest(courses)} for k in _SETTLING],
            (settling,),
        ),
        InTime(
            f"{name}_step",
            (1 + sp.tanh((TIME - symbol(step)) / _SUDDEN)) / 2,
            parameter(step, "s", "time of that change", 1.0),
            lambda courses, model: [
                {step: k / _STEPS * longest(courses)} for k in range(2, _STEPS - 1)
            ],
            (step,),
        ),
    )
