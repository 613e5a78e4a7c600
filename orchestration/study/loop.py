"""One closed loop of a study, run in one solver on the grid of its sampling period."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...solver import core
from ...solver.kernel import IntegrationError, Kernel, Model
from ..reference_signal import Reference
from ..whole_loop import reference_orders

Vector = npt.NDArray[np.float64]

STEP = 1e-3  # s, of the grid of a loop that is not sampled
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Course:
    """What a run of a loop was, on its grid of m times.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s]
    position, velocity, current, command, reference, reference_velocity : ndarray, shape (m,)
        [m], [m/s], [A], [V], [m], [m/s]
    stopped : str
        Why it ended before its time; empty if it did not.
    """

    time: Vector
    position: Vector
    velocity: Vector
    current: Vector
    command: Vector
    reference: Vector
    reference_velocity: Vector
    stopped: str = ""


@dataclass(frozen=True)
class StudyLoop:
    """A plant and a controller as one system of equations.

    Attributes
    ----------
    kernel : Kernel
        See `loop_kernel`.
    """

    kernel: Kernel = field(repr=False)

    @property
    def sampled(self) -> bool:
        """Whether the controller is."""
        return bool(self.kernel.sample_time)

    def run(
        self,
        values: Mapping[str, float],
        reference: Reference,
        stop: float,
        tolerance: float = TOLERANCE,
        step: float = STEP,
    ) -> Course:
        """Run from rest.

        Parameters
        ----------
        values : mapping of str to float
            Parameters that are not default, with the prefixes of a loop's parts.
        reference : Reference
        stop : float
            [s]
        tolerance : float
            Relative, of the solver.
        step : float
            Of the grid [s], between whose times a controller that is not sampled sees the set-point
            as a ramp. A sampled one has the grid of its samples.

        Raises
        ------
        KeyError
            For a parameter that does not exist.
        """
        model = Model(self.kernel, values, tolerance, _system(self.kernel))
        period = model.sample_time
        step = period or step
        time = np.arange(math.ceil(stop / step - 1e-9) + 1, dtype=np.float64) * step
        x_d, v_d = reference.on(time, 0), reference.on(time, 1)
        at = _inputs(self.kernel, time, reference, ramps=not period)
        before = np.vstack([at[:1], at[:-1]])
        try:
            run = model.simulate(time, (before, at), sampled_every=1 if period else 0)
        except IntegrationError as error:
            empty = np.zeros(0)
            return Course(time, *(empty,) * 4, x_d, v_d, str(error))
        y = run.outputs
        return Course(time, y["x"], y["v"], y["i"], y["u"], x_d, v_d)


def _inputs(kernel: Kernel, time: Vector, reference: Reference, ramps: bool) -> Vector:
    """Each input at each time; a controller that is not sampled sees ramps in between."""
    names = [i.name for i in kernel.inputs]
    table = np.zeros((len(time), len(names)))
    for name, order in reference_orders(kernel).items():
        values = reference.on(time, order)
        table[:, names.index(name)] = values
        if ramps:
            rates = np.diff(values, append=values[-1:]) / (time[1] - time[0])
            table[:, names.index(f"{name}_rate")] = rates
    table[:, names.index("t_step")] = time
    return table


_SYSTEMS: dict[str, core.System] = {}  # a process runs a loop many times, one run after another


def _system(kernel: Kernel) -> core.System:
    """The loop's equations, made once in a process."""
    if kernel.module not in _SYSTEMS:
        _SYSTEMS[kernel.module] = kernel.system()
    return _SYSTEMS[kernel.module]
