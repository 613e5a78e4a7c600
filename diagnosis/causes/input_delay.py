"""A command that arrives late: all of it at once, or smeared by a filter."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...solver.component import Component
from ..weak_form import lagged
from .cause import Cause, Courses, Shape, Values, of_forms, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel

_SHARES = 2.0 ** np.arange(-5.0, 4.0)  # of a sampling interval


def late(u: npt.NDArray[np.float64], delay: float, step: float) -> npt.NDArray[np.float64]:
    """Mean over each sampling interval of a held command that comes `delay` [s] late."""
    whole, share = divmod(delay / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 1, u[0]), u])[: len(u) + 1]
    return np.asarray((1.0 - share) * before[1:] + share * before[:-1])


def _delayed(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del model
    command = [(late(c.u, values["delay"], c.step) - c.u)[:, None] for c in courses]
    return Shape(("delay",), command=command, values=values, sure=0.35)


def _filtered(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del model
    command = [
        (lagged(c.u[:, None], c.step, values["command_lag"]) - c.u[:, None]) for c in courses
    ]
    return Shape(("command_lag",), command=command, values=values, sure=0.35)


def _extend_delayed(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.late_command import with_late_command

    (delay,) = _DELAY.parameters
    return with_late_command(plant, replace(delay, minimum=1e-7))


def _extend_filtered(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.late_command import with_filtered_command

    (lag,) = _LAG.parameters
    return with_filtered_command(plant, replace(lag, minimum=1e-7))


_DELAY = Cause(
    "input_delay",
    "the command reaches the drive late",
    lambda courses, model: [{"delay": float(share) * courses[0].step} for share in _SHARES],
    _delayed,
    (parameter("delay", "s", "by which the command arrives late", 1e-4),),
    _extend_delayed,
    confirm="a step of the command with the current recorded: the current begins late",
    refined=("delay",),
    late=("delay",),
    mistaken_for=("unmodelled_inertia",),
)
_LAG = replace(
    _DELAY,
    grid=lambda courses, model: [
        {"command_lag": float(share) * courses[0].step} for share in _SHARES
    ],
    at=_filtered,
    parameters=(parameter("command_lag", "s", "time constant of the command's filter", 1e-4),),
    extend=_extend_filtered,
    refined=("command_lag",),
    late=("command_lag",),
)
CAUSE = of_forms(_DELAY, _LAG)
