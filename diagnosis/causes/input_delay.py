"""A command that arrives late, by whole samples and fractions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel

_SHARES = 2.0 ** np.arange(-5.0, 4.0)  # of a sampling interval


def late(u: npt.NDArray[np.float64], delay: float, step: float) -> npt.NDArray[np.float64]:
    """Mean over each sampling interval of a held command that comes `delay` [s] late."""
    whole, share = divmod(delay / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 1, u[0]), u])[: len(u) + 1]
    return np.asarray((1.0 - share) * before[1:] + share * before[:-1])


def _grid(courses: Courses, model: DriveModel) -> list[Values]:
    del model
    return [{"delay": float(share) * courses[0].step} for share in _SHARES]


def _at(courses: Courses, model: DriveModel, values: Values) -> Shape:
    command, current = [], []
    for c in courses:
        mean = late(c.u, values["delay"], c.step)
        command.append((mean - c.u)[:, None])
        # a sample of the current sees the voltage at the end of the interval, not its mean
        last = late(c.u, values["delay"] // c.step * c.step, c.step)
        seen = (
            np.append(0.0, (last - mean)[:-1]) / model.values["R"] if model.has_motor else 0.0 * c.u
        )
        current.append(seen[:, None])
    return Shape(("delay",), command=command, current=current, values=values, sure=0.35)


def _extend(plant: Component, curve: sp.Expr) -> Component:
    del curve
    from ...plant.late_command import with_late_command

    (delay,) = CAUSE.parameters
    return with_late_command(plant, replace(delay, minimum=1e-7))


CAUSE = Cause(
    "input_delay",
    "the command reaches the drive late",
    _grid,
    _at,
    (parameter("delay", "s", "by which the command arrives late", 1e-4),),
    _extend,
    confirm="a step of the command with the current recorded: the current begins late",
    refined="delay",
    mistaken_for=("unmodelled_inertia",),
)
