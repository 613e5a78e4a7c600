"""A command that arrives late: all of it at once, or smeared by a filter or a mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import Component, symbol
from ..weak_form import lagged
from .cause import Cause, Courses, Shape, Values, Vector, of_forms, parameter

if TYPE_CHECKING:
    from ..drive_model import DriveModel

_SHARES = 2.0 ** np.arange(-5.0, 12.0)  # of a sampling interval
_LONGEST = 5e-3  # s, or eight samples


def late(u: Vector, delay: float, step: float) -> Vector:
    """Mean over each sampling interval of a held command that comes `delay` [s] late."""
    whole, share = divmod(delay / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 1, u[0]), u])[: len(u) + 1]
    return np.asarray((1.0 - share) * before[1:] + share * before[:-1])


def _times(courses: Courses) -> Vector:
    """By which a command may be late [s]."""
    step = courses[0].step
    times = _SHARES * step
    return times[times <= max(8.0 * step, _LONGEST)]


def smeared(u: Vector, window: float, step: float) -> Vector:
    """Mean over each sampling interval of the mean that a held command had over a window [s]."""
    whole, share = divmod(window / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 2, u[0]), u])
    now, last = before[1:], before[:-1]  # all intervals but the first, and those before them
    means = np.cumsum(np.append(0.0, 0.5 * (now + last)))
    count = len(u)
    ended = len(now) - count - n
    old, older = now[ended : ended + count], last[ended : ended + count]
    rest = share * old + 0.5 * share**2 * (older - old)
    return np.asarray((means[-count:] - means[-count - n :][:count] + rest) / (n + share))


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


def _filtered_twice(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del model

    def twice(u: Vector, step: float) -> Vector:
        # the second filter has what the first gives between samples on average: held, half a
        # sample late
        once = lagged(u[:, None], step, values["command_lag_twice"])
        return np.asarray(lagged(once, step, values["command_lag_twice"])[:, 0])

    command = [(twice(c.u, c.step) - c.u)[:, None] for c in courses]
    return Shape(("command_lag_twice",), command=command, values=values, sure=0.35)


def _averaged(courses: Courses, model: DriveModel, values: Values) -> Shape:
    del model
    command = [(smeared(c.u, values["command_window"], c.step) - c.u)[:, None] for c in courses]
    return Shape(("command_window",), command=command, values=values, sure=0.35)


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


def _extend_filtered_twice(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.late_command import with_command_behind

    (lag,) = _LAG_TWICE.parameters
    time = symbol(lag.name)
    return with_command_behind(plant, replace(lag, minimum=1e-7), (2 * time, time**2))


def _extend_averaged(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    from ...plant.late_command import with_command_behind

    (window,) = _WINDOW.parameters
    time = symbol(window.name)
    # Pade's approximation of a mean over a window, with a numerator of degree zero
    return with_command_behind(plant, replace(window, minimum=1e-7), (time / 2, time**2 / 12))


_DELAY = Cause(
    "input_delay",
    "the command reaches the drive late",
    lambda courses, model: [{"delay": float(time)} for time in _times(courses)],
    _delayed,
    (parameter("delay", "s", "by which the command arrives late", 1e-4),),
    _extend_delayed,
    confirm="a step of the command with the current recorded: the current begins late",
    refined=("delay",),
    late={"delay": 1.0},
    mistaken_for=("unmodelled_inertia",),
)


def _form(
    name: str,
    meaning: str,
    share: float,
    at: Callable[..., Shape],
    extend: Callable[..., Component],
) -> Cause:
    """Another form, told by one time; the command is late by this share of it."""
    return replace(
        _DELAY,
        grid=lambda courses, model: [{name: float(time)} for time in _times(courses)],
        at=at,
        parameters=(parameter(name, "s", meaning, 1e-4),),
        extend=extend,
        refined=(name,),
        late={name: share},
    )


_LAG = _form(
    "command_lag", "time constant of the command's filter", 1.0, _filtered, _extend_filtered
)
_LAG_TWICE = _form(
    "command_lag_twice",
    "time constant of each of the command's two filters",
    2.0,
    _filtered_twice,
    _extend_filtered_twice,
)
_WINDOW = _form(
    "command_window", "time over which the command is averaged", 0.5, _averaged, _extend_averaged
)
CAUSE = of_forms(_DELAY, _LAG, _LAG_TWICE, _WINDOW)
