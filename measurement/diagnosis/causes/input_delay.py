"""A command that arrives late: by a delay, or through a filter or a moving mean.

The plant has a delay or a filter as an instrument at its input. A recorded command is held from
sample to sample, so its mean over each interval is known exactly; an expression in time has no such
steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import comb

import numpy as np
import sympy as sp

from ....plant.instruments.late_command import with_command_behind, with_late_command
from ....solver.arrays import Vector
from ....solver.component import Component, Parameter, symbol
from ..drive import Drive
from ..weak_form import lagged
from .cause import Cause, Courses, Mechanism, Shape, Values, parameter

_SHARES = 2.0 ** np.arange(-5.0, 12.0)  # delays over a sampling interval
_LONGEST = 5e-3  # longest delay [s]; at least eight samples


def late(u: Vector, delay: float, step: float) -> Vector:
    """Mean over each sampling interval of a held command that comes `delay` [s] late."""
    whole, share = divmod(delay / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 1, u[0]), u])[: len(u) + 1]
    return np.asarray((1.0 - share) * before[1:] + share * before[:-1])


def _times(courses: Courses) -> Vector:
    """Delays to try [s]."""
    step = courses[0].step
    times = _SHARES * step
    return times[times <= max(8.0 * step, _LONGEST)]


def smeared(u: Vector, window: float, step: float) -> Vector:
    """Mean over each sampling interval of a held command averaged over a moving window [s]."""
    whole, share = divmod(window / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 2, u[0]), u])
    now, last = before[1:], before[:-1]  # all intervals except the first, and their predecessors
    means = np.cumsum(np.append(0.0, 0.5 * (now + last)))
    count = len(u)
    ended = len(now) - count - n
    old, older = now[ended : ended + count], last[ended : ended + count]
    rest = share * old + 0.5 * share**2 * (older - old)
    return np.asarray((means[-count:] - means[-count - n :][:count] + rest) / (n + share))


def _late_by(
    name: str,
    meaning: str,
    arrives: Callable[[Vector, float, float], Vector],
    built: Callable[[Component, Parameter], Component],
) -> Mechanism:
    """A command delayed by one time parameter."""
    time = parameter(name, "s", meaning, 1e-4)

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        command = [(arrives(c.u, values[name], c.step) - c.u)[:, None] for c in courses]
        return Shape((name,), command=command, values=values, sure=0.35)

    return Mechanism(
        (time,),
        at,
        lambda courses, model: [{name: float(t)} for t in _times(courses)],
        lambda plant, curve, cause: built(plant, replace(time, minimum=1e-7)),
        name,
    )


def _behind_filters(name: str, meaning: str, count: int) -> Mechanism:
    """A command behind first-order filters in series.

    Along a record, the input of each filter is the mean output of the previous one over an
    interval, held.
    """

    def arrives(u: Vector, time_constant: float, step: float) -> Vector:
        given = u[:, None]
        for _ in range(count):
            given = lagged(given, step, time_constant)
        return np.asarray(given[:, 0])

    time = symbol(name)
    return _late_by(
        name, meaning, arrives, _behind([comb(count, k) * time**k for k in range(1, count + 1)])
    )


def _behind(coefficients: Sequence[sp.Expr]) -> Callable[[Component, Parameter], Component]:
    """Function that adds a filter to a plant's command, see `with_command_behind`."""
    return lambda plant, time: with_command_behind(plant, time, coefficients)


_WINDOW = symbol("command_window")
CAUSE = Cause(
    "input_delay",
    "the command reaches the drive late",
    (
        _late_by("delay", "by which the command arrives late", late, with_late_command),
        _behind_filters("command_lag", "time constant of the command's filter", 1),
        _behind_filters(
            "command_lag_twice", "time constant of each of the command's two filters", 2
        ),
        _late_by(
            _WINDOW.name,
            "time over which the command is averaged",
            smeared,
            # Pade's approximation of a mean over a window, with a numerator of degree zero
            _behind([_WINDOW / 2, _WINDOW**2 / 12]),
        ),
    ),
    confirm="record the current during a step of the command: the current starts late",
    mistaken_for=("unmodelled_inertia",),
)
