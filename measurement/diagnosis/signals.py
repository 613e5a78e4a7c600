"""Errors of recorded signals: a wrong scale, a wrong sign, a shifted time.

They are suspects like the causes of the catalogue, but they correct the record and not
the plant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...solver.arrays import Vector
from .causes import CAUSES
from .causes.cause import Cause, Courses, Shape, Smaller, Values, of_command

if TYPE_CHECKING:
    from .drive import Drive
    from .modelled_record import ModelledRecord

_SHIFTS = (*range(-20, 0), *range(1, 21))
"""Shifts of the command's stamps, in sampling intervals; `command_shift` covers smaller ones."""

_CERTAIN = 0.01
"""Spread of an amplitude around one: no half sign; half a shift would average command noise."""

CURRENT_GAIN = "current_gain"
"""The calibration that a wrong scale of the current frees."""


@dataclass(frozen=True)
class Signal:
    """One possible error of a recorded signal.

    Attributes
    ----------
    name, says : str
    grid, at
        As in `Cause`.
    confirm : str
    smaller
        As in `Cause`: otherwise a signal that is made smaller would have a smaller residual.
    """

    name: str
    says: str
    grid: Callable[[Courses, Drive], list[Values]]
    at: Callable[[Courses, Drive, Values], Shape]
    confirm: str
    smaller: Smaller | None = None


def _inertial(course: ModelledRecord, model: Drive) -> Vector:
    """Force that grows with the scale of x, shape (n,) [N]."""
    return model.inertia * course.mean_a + model.linear_friction * course.middle_v


def _motion(model: Drive, course: ModelledRecord, force: Vector) -> tuple[Vector, Vector]:
    """A force, and the command equivalent to the motion's back-EMF, columns (n, 1)."""
    emf = model.back_emf * course.middle_v if model.has_motor else np.zeros(len(course.x))
    return force[:, None], -emf[:, None]


def _scale_of_u(courses: Courses, model: Drive, values: Values) -> Shape:
    return Shape(("scale_of_u",), command=[c.u[:, None] for c in courses], values=values)


def _scale_of_i(courses: Courses, model: Drive, values: Values) -> Shape:
    return Shape(("scale_of_i",), values=values, freed=(CURRENT_GAIN,))


def _scale_of_x(courses: Courses, model: Drive, values: Values) -> Shape:
    parts = [_motion(model, c, _inertial(c, model)) for c in courses]
    force, command = ([p[k] for p in parts] for k in (0, 1))
    return Shape(("scale_of_x",), force=force, command=command, values=values)


def _sign_of_u(courses: Courses, model: Drive, values: Values) -> Shape:
    command = [-2.0 * c.u[:, None] for c in courses]
    return Shape(("sign_of_u",), command=command, values=values, sure=_CERTAIN)


def _sign_of_x(courses: Courses, model: Drive, values: Values) -> Shape:
    parts = [_motion(model, c, _inertial(c, model) + c.bristle) for c in courses]
    force, command = ([-2.0 * p[k] for p in parts] for k in (0, 1))
    return Shape(("sign_of_x",), force=force, command=command, values=values, sure=_CERTAIN)


def _shifts(courses: Courses, model: Drive) -> list[Values]:
    return [{"shift": float(k)} for k in _SHIFTS]


def _time_shift(courses: Courses, model: Drive, values: Values) -> Shape:
    command = []
    for c in courses:
        at = np.clip(np.arange(len(c.u)) - int(values["shift"]), 0, len(c.u) - 1)
        command.append((c.u[at] - c.u)[:, None])
    return Shape(("time_shift",), command=command, values=values, sure=_CERTAIN)


def _once(courses: Courses, model: Drive) -> list[Values]:
    return [{}]


def _with_current(courses: Courses, model: Drive) -> list[Values]:
    return [{}] if all(c.has_current for c in courses) else []


def entry(name: str) -> Cause | Signal:
    """The cause or the signal of this name."""
    return CAUSES.get(name) or SIGNALS[name]


SIGNALS: dict[str, Signal] = {
    s.name: s
    for s in (
        Signal(
            "scale_of_u",
            "the recorded command has a wrong scale",
            _once,
            _scale_of_u,
            "measure the voltage at the motor with a meter",
            smaller=of_command,
        ),
        Signal(
            "scale_of_i",
            "the recorded current has a wrong scale",
            _with_current,
            _scale_of_i,
            "measure the current with a clamp",
        ),
        Signal(
            "scale_of_x",
            "the recorded position has a wrong scale",
            _once,
            _scale_of_x,
            "move by a known distance and read the position",
            smaller=lambda courses, shape, amplitudes: min(abs(1.0 + float(amplitudes[0])), 1.0),
        ),
        Signal(
            "sign_of_u",
            "the recorded command has the wrong sign",
            _once,
            _sign_of_u,
            "command a small positive voltage and check the direction of motion",
        ),
        Signal(
            "sign_of_x",
            "the recorded position has the wrong sign",
            _once,
            _sign_of_x,
            "move in +x by hand and read the position",
        ),
        Signal(
            "time_shift",
            "the time stamps of command and position are shifted against each other",
            _shifts,
            _time_shift,
            "record a step of the command: the current or the position responds at once",
        ),
    )
}
