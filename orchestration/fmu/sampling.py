"""Whether a controller of somebody else computes its outputs in its steps only, by a trial.

FMI 2.0 does not tell. Such a controller is run as a digital one: shorter communication steps would
make another controller of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ...fmus.reading import Description
from .fmu_instance import SAMPLE_TIME, FmuInstance, StepFailed
from .isolated import IsolatedInstance

_MOVED = 1e-3  # of its size, by which an input moves
_SHORT = 1e-3  # of a step
Fmu = FmuInstance | IsolatedInstance


def answers_in_steps(
    fmu: Description,
    opened: Callable[[], Fmu],
    values: Mapping[str, float],
    stop: float,
    step: float,
) -> bool:
    """Whether outputs stay when inputs change, and move as far in a very short step as in a long.

    What moves less in a shorter step are states of a continuous controller.

    Parameters
    ----------
    fmu : Description
    opened : function
        Opens an instance.
    values : mapping of str to float
        Its parameters that are not default.
    stop, step : float
        End of the run and communication step [s].
    """
    if SAMPLE_TIME in (v.name for v in fmu.variables):
        return False  # its parameter for the period is known, and read at initialization
    declared = any(v.sampled and v.causality == "output" for v in fmu.variables)
    if not declared and (fmu.saves_state or not fmu.steps_vary):
        return False  # its steps are tried out from saved states, or cannot be tried
    short = _SHORT * step if fmu.steps_vary else step
    whole = _moved(opened(), values, stop, step)
    return whole > 0.0 and _moved(opened(), values, stop, short) > 0.5 * whole


def _moved(probe: Fmu, values: Mapping[str, float], stop: float, step: float) -> float:
    """How far outputs move in a step after inputs have moved; 0 if they follow inputs at once."""
    try:
        probe.initialize({n: v for n, v in values.items() if n in probe.parameters}, stop)
        inputs = [n for n in probe.inputs if probe.is_real(n)]
        read = probe.reader([n for n in probe.outputs if probe.is_real(n)])
        before = read()
        probe.writer(inputs)(_MOVED * np.array([probe.nominal(n) for n in inputs]))
        if not np.array_equal(read(), before):
            return 0.0
        probe.step(0.0, step)
        return float(np.abs(read() - before).max(initial=0.0))
    except StepFailed:
        return 0.0  # the run itself will report the error
    finally:
        probe.close()
