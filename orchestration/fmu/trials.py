"""What a third-party FMU does, found out by trials: FMI does not tell, or the FMU tells it wrongly.

A controller that computes its outputs in its steps only is run as a digital one: shorter
communication steps would make another controller of it. Saved states that are not really restored
are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ...fmus.made_here import is_ours
from ...fmus.reading import Description
from ...solver.errors import FmuError
from .fmu_instance import SAMPLE_TIME, FmuInstance, Reader, StepFailed, Value
from .isolated import IsolatedInstance

Vector = npt.NDArray[np.float64]
Fmu = FmuInstance | IsolatedInstance

_MOVED = 1e-3  # of its size, by which an input moves
_SHORT = 1e-3  # of a step
STEPS = 8  # before the state is saved, and after
SAME = 1e-5  # of an output's size: largest difference of two passes, since solvers restart
_TRIED: dict[tuple[str, int, int], bool] = {}  # by path, time and size of the file


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


def check_state(fmu: Fmu, values: Mapping[str, Value], stop: float, step: float) -> tuple[str, ...]:
    """Do not use an FMU's saved states if it does not really restore them; return a note on it.

    A new instance is tried, with the given parameters.
    """
    if not fmu.can_save or is_ours(fmu.path):
        return ()
    about = fmu.path.stat()
    key = (str(fmu.path.resolve()), about.st_mtime_ns, about.st_size)
    if key not in _TRIED:
        _TRIED[key] = _comes_back(fmu, values, stop, step)
    if _TRIED[key]:
        return ()
    fmu.can_save = False
    return (
        f"{fmu.path.name} declares that it can save its state but does not restore it correctly: "
        "it runs without saved states (pythonfmu build --handle-state saves only registered "
        "variables: "
        "register all variables that do_step changes)",
    )


class _NotKept(Exception):
    """A state was not saved or not restored."""


def _done(call: Callable[[], Any], read: Reader) -> Any:
    try:
        result = call()
        read()  # a process of its own answers only now
    except StepFailed as error:
        raise _NotKept from error
    return result


def _comes_back(fmu: Fmu, values: Mapping[str, Value], stop: float, step: float) -> bool:
    """Whether steps from a saved state give the same results twice; True if they are impossible."""
    about = fmu.description
    free = min(step, stop / (2 * STEPS + 1))
    h = free if about.steps_vary else about.step_size or step
    inputs = [name for name in fmu.inputs if fmu.is_real(name)]
    sizes = np.array([fmu.nominal(name) for name in inputs])
    random = np.random.default_rng(0)
    moves = sizes * random.uniform(0.5, 1.0, (2 * STEPS, len(inputs)))
    try:
        trial = fmu.reopened()
    except FmuError:
        return True
    try:
        trial.initialize(values, stop)
        write, read = trial.writer(inputs), trial.reader(trial.outputs)

        def passed(first: int) -> Vector:
            rows = []
            for k in range(first, first + STEPS):
                if (k + 1) * h <= stop:
                    write(moves[k])
                    trial.step(k * h, h)
                    rows.append(read())
            return np.array(rows)

        passed(0)
        state = _done(trial.save, read)
        once = passed(STEPS)
        _done(lambda: trial.restore(state), read)
        again = passed(STEPS)
        trial.release(state)
    except _NotKept:
        return False
    except StepFailed:
        return True  # the run itself will report the error
    finally:
        trial.close()
    allowed = SAME * np.abs(once).max(axis=0, initial=0.0)
    return bool(np.all((np.abs(again - once) <= allowed) | ~np.isfinite(once)))
