"""One closed loop of a study, in one solver or with an FMU as controller, on a grid of times."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...solver import core
from ...solver.kernel import CONTROLLER, PLANT, Kernel, Model, ParameterInfo
from ..closed_loop import opened, run_parts
from ..fmu_instance import StepFailed
from ..loop import Loop
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


@dataclass(frozen=True)
class FmuLoop:
    """As `StudyLoop`, with an FMU as controller: both parts are FMUs, coupled by the master.

    Attributes
    ----------
    loop : Loop
        With its sampling period, if it is a digital controller.
    """

    loop: Loop

    @property
    def kernel(self) -> FmuLoop:
        """What a study asks of a kernel: the parameters, and what changes with the equations."""
        return self

    @cached_property
    def parameters(self) -> tuple[ParameterInfo, ...]:
        """Of both parts, with the prefixes of a loop's parts."""
        sides = (PLANT, self.loop.plant), (CONTROLLER, self.loop.controller)
        return tuple(
            replace(p, name=side + n) for side, part in sides for n, p in part.parameters.items()
        )

    @property
    def module(self) -> str:
        """The content of both parts."""
        digest = hashlib.sha256(self.loop.controller.fmu().read_bytes()).hexdigest()
        return self.loop.plant.kernel.module + digest

    def run(
        self,
        values: Mapping[str, float],
        reference: Reference,
        stop: float,
        tolerance: float = TOLERANCE,
        step: float = STEP,
    ) -> Course:
        """As `StudyLoop.run`; with a finer tolerance than usual, steps of the master are halved."""
        step = self.loop.sampled or (step if tolerance >= TOLERANCE else 0.5 * step)
        count = math.ceil(stop / step - 1e-9)
        loop = replace(
            self.loop,
            reference=reference,
            stop=count * step,
            plant_values=of_side(PLANT, values),
            controller_values=of_side(CONTROLLER, values),
        )
        try:
            with opened(loop) as (plant, controller):
                found, _ = run_parts(loop, plant, controller, step, look_again=False)
            stopped = found.stopped
        except StepFailed as error:
            stopped = str(error)
        time = np.arange(0 if stopped else count + 1, dtype=np.float64) * step
        x_d, v_d = reference.on(time, 0), reference.on(time, 1)
        if stopped:
            return Course(time, time, time, time, time, x_d, v_d, stopped)
        none = np.full(len(found.time), np.nan)
        signals = [found.outputs.get(n, none) for n in ("x", "v", "i")]
        x, v, i, u = (np.interp(time, found.time, s) for s in (*signals, found.commands["u"]))
        return Course(time, x, v, i, u, x_d, v_d)


def of_side(side: str, values: Mapping[str, float]) -> dict[str, float]:
    """The values of one part of a loop, by the part's own names."""
    return {n.removeprefix(side): v for n, v in values.items() if n.startswith(side)}


_SYSTEMS: dict[str, core.System] = {}  # a process runs a loop many times, one run after another


def _system(kernel: Kernel) -> core.System:
    """The loop's equations, made once in a process."""
    if kernel.module not in _SYSTEMS:
        _SYSTEMS[kernel.module] = kernel.system()
    return _SYSTEMS[kernel.module]
