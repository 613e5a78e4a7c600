"""One closed loop of a study, run in one solver on the grid of its sampling period."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...solver import core
from ...solver.kernel import Kernel, Model
from ..reference_signal import Reference
from ..whole_loop import follow

Vector = npt.NDArray[np.float64]

STEP = 1e-3  # s, of the grid of a loop that is not sampled
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Course:
    """A run of a loop, on its grid of m times.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s]
    position, velocity, current, command, reference, reference_velocity : ndarray, shape (m,)
        [m], [m/s], [A], in the unit of the plant's command, [m], [m/s]. The current is NaN for a
        plant without a current.
    stopped : str
        Why it ended early; empty if it did not.
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
            Parameters that differ from their defaults, with the prefixes of a loop's parts.
        reference : Reference
        stop : float
            [s]
        tolerance : float
            Relative, of the solver.
        step : float
            Of the grid [s]. A sampled controller has the grid of its samples.

        Raises
        ------
        KeyError
            For a parameter that does not exist.
        """
        model = Model(self.kernel, values, tolerance, _system(self.kernel))
        step = model.sample_time or step
        time = np.arange(math.ceil(stop / step - 1e-9) + 1, dtype=np.float64) * step
        x_d, v_d = reference.on(time, 0), reference.on(time, 1)
        y, stopped = follow(model, reference, time)
        if stopped:
            y = dict.fromkeys("xviu", np.zeros(0))
        current = y.get("i", np.full(len(time), np.nan))  # a plant driven by a force has none
        return Course(time, y["x"], y["v"], current, y["u"], x_d, v_d, stopped)


_SYSTEMS: dict[str, core.System] = {}  # a process runs a loop many times, one run after another


def _system(kernel: Kernel) -> core.System:
    """The loop's equations, made once in a process."""
    if kernel.module not in _SYSTEMS:
        _SYSTEMS[kernel.module] = kernel.system()
    return _SYSTEMS[kernel.module]
