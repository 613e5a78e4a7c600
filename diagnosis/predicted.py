"""The position that a model predicts from the recorded state at the start of each second.

The method is the same for every law: the package's solver solves the model's component, with its
causes, under the recorded command. So a classical law sticks in a mode with events, and bristles
are states. States that are not recorded (bristles, the current, a block behind a joint) are
computed by solving the component from sample to sample; its position and velocity are reset to the
recorded ones at each sample. At rest, the bristles then balance the force of the command.
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
_BESIDE = {"xb": "x", "vb": "v", "xl": "x", "vl": "v"}  # initial states from the encoder's side


class NotPredicted(ValueError):
    """No position can be predicted; the message says why."""


class Predictor:
    """The equations of a drive with causes, to predict the motion of a record.

    Parameters
    ----------
    drive : Drive
    causes : mapping of str to mapping of str to float
        Without causes in the command, see `__call__`.
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
            Change of the command by causes in the command.

        Raises
        ------
        NotPredicted
            If the plant cannot have these causes, or its equations cannot be solved.
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
    """Set the first mode, so that velocity and forces decide again whether the body sticks."""
    if model.kernel.modes:
        model.u[-1] = 0.0
