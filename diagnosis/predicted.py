"""The position that a model predicts from the recorded state at the start of each second.

One way for every law: the model's own component, with its causes, is solved by the package's
solver under the recorded command. So a classical law has its set-valued rest, as a mode with
events, and bristles are states. What nobody recorded (bristles, the current, a block behind a
joint) is what the component makes of the record until then: it is solved from sample to sample,
and its position and velocity are put back to the recorded ones at each. In a rest the bristles so
come to hold what the command asks of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..plant.two_masses import OneBody
from ..solver.codegen import generate
from ..solver.component import ContractError
from ..solver.kernel import IntegrationError, Kernel, Model
from .drive import Drive
from .held_out import ends_of_seconds
from .modelled_record import ModelledRecord
from .with_causes import BadExtension, with_causes

Vector = npt.NDArray[np.float64]

_TOLERANCE = 1e-6
_BESIDE = {"xb": "x", "vb": "v", "xl": "x", "vl": "v"}  # what begins where the encoder's side does


class NotPredicted(ValueError):
    """No position can be predicted; the message says why."""


class Predictor:
    """The equations of a drive with causes, and what they make of a record.

    Parameters
    ----------
    drive : Drive
    causes : mapping of str to mapping of str to float
        Those of the command are not among them, see `__call__`.
    """

    def __init__(self, drive: Drive, causes: Mapping[str, Mapping[str, float]]) -> None:
        self._drive, self._causes = drive, causes

    @cached_property
    def _kernel(self) -> Kernel:
        try:
            kernel = generate(with_causes(self._drive, list(self._causes.items())))
        except (BadExtension, OneBody, ContractError) as error:
            raise NotPredicted(str(error)) from error
        kernel.compile()
        return kernel

    def __call__(self, course: ModelledRecord, change: Vector) -> Vector:
        """Position from the recorded state at the start of each second, shape (n,) [m].

        Parameters
        ----------
        change : ndarray, shape (n,)
            Of the command, by causes that are part of it.

        Raises
        ------
        NotPredicted
            If no plant can have these causes, or its equations cannot be solved.
        """
        command = course.u + course.calibration["command_shift"] * course.next_change + change
        model = Model(self._kernel, tolerance=_TOLERANCE)
        out = np.empty(len(course.x))
        try:
            states = _states(model, course, command)
            for first, last in itertools.pairwise(ends_of_seconds([course])):
                model.x[:] = states[first]
                _let_go(model)
                now = command[first:last, None]
                given = np.vstack([now[:1], now[:-1]]), now
                out[first:last] = model.simulate(course.time[first:last], given).states["x"]
        except IntegrationError as error:
            raise NotPredicted(str(error)) from error
        return out


def _states(model: Model, course: ModelledRecord, command: Vector) -> npt.NDArray[np.float64]:
    """The component's state at each sample, shape (n, states)."""
    names = [s.name for s in model.kernel.states]
    for name, encoder in _BESIDE.items():
        if name in names:
            model.x[names.index(name)] = getattr(course, encoder)[0]
    measured = [names.index("x"), names.index("v")]
    motion = np.column_stack([course.x, course.v])
    states = np.empty((len(motion), len(names)))
    inner = len(names) > len(measured)
    for k, t in enumerate(course.time):
        model.x[measured] = motion[k]
        states[k] = model.x
        if inner and k + 1 < len(motion):
            _let_go(model)
            model.u[0] = command[k]
            model.advance(t, course.time[k + 1])
    return states


def _let_go(model: Model) -> None:
    """Forget whether the body stuck: its velocity and forces decide again, in the first mode."""
    if model.kernel.modes:
        model.u[-1] = 0.0
