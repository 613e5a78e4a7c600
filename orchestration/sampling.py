"""Detect whether a third-party controller is sampled, and its period, from its commands.

FMI 2.0 has no clocks: a description does not give the period of a controller that reads its inputs
at its own instants and holds its commands between them. But the period is visible: if the inputs
move in every step, the commands stay for several steps and then jump, at regular intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..fmus.reading import Description, FmuError
from .fmu_instance import SAMPLE_TIME, FmuInstance, StepFailed
from .isolated import IsolatedInstance
from .wiring import Wiring

_STAGES = ((0.125, 200), (1.0, 1000))  # probing step, in communication steps, and their number
_JUMPS = 12  # of the command are sufficient
_LEAST = 3
_MOVED = 1e-3  # of its size, by which an input moves in each step
_EVERY_STEP = 4  # jumps in successive steps: no sampling is visible with these steps


class UnknownPeriod(ValueError):
    """A controller is sampled, but its period is not known; the message says what to do."""


@dataclass(frozen=True)
class Period:
    """The period of a sampled controller [s], and where it was found; 0: it is not sampled."""

    seconds: float
    found: str = ""


def sampling_period(
    controller: FmuInstance | IsolatedInstance,
    wiring: Wiring,
    sizes: npt.NDArray[np.float64],
    values: Mapping[str, float],
    stop: float,
    step: float,
) -> Period:
    """The period at which a controller samples, from its description and from a trial.

    Parameters
    ----------
    controller : FmuInstance or IsolatedInstance
        Not changed; a new instance is tried.
    wiring : Wiring
    sizes : ndarray, shape (n,)
        Typical magnitudes of the signals that it measures.
    values : mapping of str to float
        Its parameters that are not default.
    stop, step : float
        End of the run and communication step [s].

    Raises
    ------
    UnknownPeriod
    """
    if SAMPLE_TIME in controller.parameters:
        return Period(0.0)  # its parameter for the period is known, and read at initialization
    for share, count in _STAGES:
        h = share * step
        jumps = _jumps(controller, wiring, sizes, values, stop, h, count)
        if _in_a_row(jumps):
            return Period(0.0)
        apart = np.diff(jumps)
        if len(jumps) >= _LEAST and apart.min() >= 2 and np.ptp(apart) <= 1:
            return _named(controller.description, values, jumps, h)
    commands = {name for name, _ in wiring.commands}
    declared = any(v.sampled for v in controller.description.variables if v.name in commands)
    if declared and controller.description.step_size:
        return Period(controller.description.step_size, "the step size of its default experiment")
    if declared:
        raise UnknownPeriod(
            f"{controller.description.identifier} declares discrete commands "
            f"without a period; name its period parameter {SAMPLE_TIME}"
        )
    return Period(0.0)


def _jumps(
    controller: FmuInstance | IsolatedInstance,
    wiring: Wiring,
    sizes: npt.NDArray[np.float64],
    values: Mapping[str, float],
    stop: float,
    h: float,
    count: int,
) -> list[int]:
    """Numbers of the steps in which commands changed, while the inputs changed in all steps."""
    sized = dict(zip((name for _, name in wiring.signals), sizes, strict=True))
    inputs = [n for n in (*sized, *wiring.references) if controller.is_real(n)]
    sizes = np.array([sized.get(name, 1.0) for name in inputs])
    random = np.random.default_rng(0)
    jumps: list[int] = []
    try:
        probe = controller.reopened()
    except FmuError:
        return jumps
    try:
        probe.initialize(values, stop)
        write = probe.writer(inputs)
        read = probe.reader([name for name, _ in wiring.commands])
        before = read()
        for k in range(min(count, int(stop / h * (1 - 1e-9)))):
            write(_MOVED * sizes * random.uniform(0.5, 1.0, len(inputs)))
            probe.step(k * h, h)
            now = read()
            if not np.array_equal(now, before):
                jumps.append(k)
            before = now
            if len(jumps) >= _JUMPS or _in_a_row(jumps):
                break
    except StepFailed:
        pass  # the run itself will report the error
    finally:
        probe.close()
    return jumps


def _in_a_row(jumps: list[int]) -> bool:
    """Whether the last jumps came in successive steps."""
    last = jumps[-_EVERY_STEP:]
    return len(last) == _EVERY_STEP and last[-1] - last[0] == _EVERY_STEP - 1


def _named(
    description: Description,
    values: Mapping[str, float],
    jumps: list[int],
    h: float,
) -> Period:
    """The exact period: a parameter or default step that fits the jumps, or whole steps."""
    way, spaces = jumps[-1] - jumps[0], len(jumps) - 1
    low, high = (way - 1) * h / spaces, (way + 1) * h / spaces
    told = {
        v.name: values.get(v.name, v.start)
        for v in description.variables
        if v.causality == "parameter" and v.is_real and v.unit in ("", "s")
    }
    for name, value in told.items():
        if value is not None and low < value < high:
            return Period(value, f"its parameter {name}")
    if description.step_size and low < description.step_size < high:
        return Period(description.step_size, "the step size of its default experiment")
    if np.ptp(np.diff(jumps)) == 0 and way % spaces == 0:
        return Period(way // spaces * h, "the interval between jumps of its commands")
    raise UnknownPeriod(
        f"{description.identifier} holds its commands for about {way / spaces * h:.4g} s: it is "
        f"sampled, but no parameter has this value; name its period parameter {SAMPLE_TIME}"
    )
