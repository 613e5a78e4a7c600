"""The position that a model predicts from the recorded state at the start of each second.

The method is the same for every law: the package's solver solves the model's component, with its
causes, under the recorded command. States that are not recorded (bristles, the current, a block
behind a joint) come from solving it from sample to sample, with its position and velocity reset to
the recorded ones at each. At rest, the bristles then balance the force of the command.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property

import numpy as np

from ...solver.arrays import Matrix, Vector
from ...solver.codegen import generate
from ...solver.component import Component
from ...solver.errors import ContractError
from ...solver.kernel import IntegrationError, Kernel, Model
from .corrected import with_causes
from .model import Drive
from .motion import Course

Causes = Mapping[str, Mapping[str, float]]

_AHEAD = 1.0  # time over which a position is predicted from a known state [s]
_TOLERANCE = 1e-6
_BESIDE = {"xb": "x", "vb": "v", "xl": "x", "vl": "v"}  # initial states from the encoder's side


class NotPredicted(ValueError):
    """No position can be predicted; the message says why."""


class Predictor:
    """The equations of a drive with causes, to predict the motion of a record.

    The causes have none in the command, which changes the command instead. `like` is a predictor
    of a drive with the same causes and other values, whose equations are used.
    """

    def __init__(self, drive: Drive, causes: Causes, like: Predictor | None = None) -> None:
        self._drive, self._causes, self._like = drive, causes, like

    @cached_property
    def _plant(self) -> Component:
        try:
            return with_causes(self._drive, list(self._causes.items()))
        except ContractError as error:
            raise NotPredicted(str(error)) from error

    @cached_property
    def _kernel(self) -> Kernel:
        if self._like is not None:
            return self._like._kernel
        kernel = generate(self._plant)
        kernel.compile()
        return kernel

    def __call__(
        self,
        course: Course,
        change: Vector,
        seconds: Sequence[tuple[int, int]] | None = None,
        states: Matrix | None = None,
    ) -> Vector:
        """Position from the recorded state at the start of each second, shape (n,) [m].

        `change` is that of the command by causes in the command, shape (n,). Only the `seconds`,
        (first, end), are predicted if they are given; other samples are NaN. `states` are those of
        `states`, if they are known already. Raises NotPredicted if the plant cannot have these
        causes, or its equations cannot be solved.
        """
        if states is None:
            states = self.states(course, change)
        if seconds is None:
            seconds = list(itertools.pairwise(ends_of_seconds([course])))
        model, command = self._along(course, change)
        out = np.full(len(course.x), np.nan)
        with _solved():
            for first, last in seconds:
                model.x[:] = states[first]
                model.x[self._measured] = course.x[first], course.v[first]
                _let_go(model)
                now = command[first:last, None]
                given = np.vstack([now[:1], now[:-1]]), now
                out[first:last] = model.simulate(course.time[first:last], given).states["x"]
        return out

    def states(self, course: Course, change: Vector) -> Matrix:
        """The component's state at each sample, shape (n, states); arguments as in a call."""
        model, command = self._along(course, change)
        names = [s.name for s in self._kernel.states]
        for name, encoder in _BESIDE.items():
            if name in names:
                model.x[names.index(name)] = getattr(course, encoder)[0]
        motion, measured = np.column_stack([course.x, course.v]), self._measured
        states, time = np.empty((len(motion), len(names))), course.time.tolist()
        if len(names) == len(measured):
            states[:, measured] = motion
            return states
        with _solved():
            for k, t in enumerate(time):
                model.x[measured] = motion[k]
                states[k] = model.x
                if k + 1 < len(motion):
                    _let_go(model)
                    model.u[0] = command[k]
                    model.advance(t, time[k + 1])
        return states

    @property
    def _measured(self) -> list[int]:
        names = [s.name for s in self._kernel.states]
        return [names.index("x"), names.index("v")]

    def _along(self, course: Course, change: Vector) -> tuple[Model, Vector]:
        """The equations with the values of this record, and its command."""
        values = {p.name: p.default for p in self._plant.all_parameters}
        if course.offset_name:
            values["offset"] += course.own_offset
        command = course.u + course.calibration["command_shift"] * course.next_change + change
        return Model(self._kernel, values, tolerance=_TOLERANCE), command


@contextmanager
def _solved() -> Iterator[None]:
    try:
        yield
    except IntegrationError as error:
        raise NotPredicted(str(error)) from error


def _let_go(model: Model) -> None:
    """Set the first mode, so that velocity and forces decide again whether the body sticks."""
    if model.kernel.modes:
        model.u[-1] = 0.0


def ends_of_seconds(courses: Sequence[Course]) -> list[int]:
    """Ends of the seconds over which positions are predicted, among all samples."""
    ends = [0]
    for c in courses:
        start, n = ends[-1], len(c.x)
        every = max(2, min(round(_AHEAD / c.step), n))
        ends += [start + k for k in (*range(every, n, every), n)]
    return ends
