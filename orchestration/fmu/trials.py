"""What a third-party FMU does, found out by trials; a controller stepped at its samples only.

FMI does not tell it, or the FMU tells it wrongly. A controller that computes its outputs in its
steps only is run as a digital one: shorter communication steps would make another controller of it.
Saved states that are not really restored are not used.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...fmus.made_here import is_ours
from ...fmus.ports import law_ports
from ...fmus.reading import Description
from ...solver.arrays import Vector
from ...solver.errors import FmuError
from .fmu_instance import SAMPLE_TIME, AnyFmu, StepFailed, Stepped, Value, Wrapped, Writer

_MOVED = 1e-3  # of its size, by which an input moves
_SHORT = 1e-3  # of a step
STEPS = 8  # before the state is saved, and after
SAME = 1e-5  # of an output's size: largest difference of two passes, since solvers restart
CLOSE = 1e-6  # of a period: times closer than this are the same
_TRIED: dict[tuple[str, int, int], bool] = {}  # by path, time and size of the file


def answers_in_steps(
    fmu: Description,
    opened: Callable[[], AnyFmu],
    values: Mapping[str, float],
    stop: float,
    step: float,
) -> bool:
    """Whether outputs stay when inputs change, and move as far in a very short step as in a long.

    What moves less in a shorter step are states of a continuous controller. `values` are parameters
    that are not default; `stop` and `step` [s] are those of the run.
    """
    if SAMPLE_TIME in fmu.by_name:
        return False  # its parameter for the period is known, and read at initialization
    declared = any(v.sampled and v.causality == "output" for v in fmu.variables)
    if not declared and (fmu.saves_state or not fmu.steps_vary):
        return False  # its steps are tried out from saved states, or cannot be tried
    short = _SHORT * step if fmu.steps_vary else step
    whole = _moved(opened(), values, stop, step)
    return whole > 0.0 and _moved(opened(), values, stop, short) > 0.5 * whole


def _moved(fmu: AnyFmu, values: Mapping[str, float], stop: float, step: float) -> float:
    """How far outputs move in a step after inputs have moved; 0 if they follow inputs at once."""
    # the run itself will report an error
    with contextlib.closing(fmu) as probe, contextlib.suppress(StepFailed):
        probe.initialize({n: v for n, v in values.items() if n in probe.parameters}, stop)
        inputs = [n for n in probe.inputs if probe.is_real(n)]
        read = probe.reader([n for n in probe.outputs if probe.is_real(n)])
        before = read()
        probe.writer(inputs)(_MOVED * np.array([probe.nominal(n) for n in inputs]))
        if np.array_equal(read(), before):
            probe.step(0.0, step)
            return float(np.abs(read() - before).max(initial=0.0))
    return 0.0


def check_state(fmu: AnyFmu, values: Mapping[str, Value], stop: float, step: float) -> list[str]:
    """Do not use an FMU's saved states if it does not really restore them; return a note on it.

    A new instance is tried, with the given parameters.
    """
    if not fmu.can_save or is_ours(fmu.path):
        return []
    about = fmu.path.stat()
    key = (str(fmu.path.resolve()), about.st_mtime_ns, about.st_size)
    if key not in _TRIED:
        _TRIED[key] = _comes_back(fmu, values, stop, step)
    if _TRIED[key]:
        return []
    fmu.can_save = False
    return [
        f"{fmu.path.name} declares that it can save its state but does not restore it correctly: "
        "it runs without saved states (pythonfmu build --handle-state saves only registered "
        "variables: register all variables that do_step changes)"
    ]


def _comes_back(fmu: AnyFmu, values: Mapping[str, Value], stop: float, step: float) -> bool:
    """Whether steps from a saved state give the same results twice; True if they are impossible."""
    about = fmu.description
    h = min(step, stop / (2 * STEPS + 1)) if about.steps_vary else about.step_size or step
    inputs = [name for name in fmu.inputs if fmu.is_real(name)]
    sizes = np.array([fmu.nominal(name) for name in inputs])
    moves = sizes * np.random.default_rng(0).uniform(0.5, 1.0, (2 * STEPS, len(inputs)))
    saving = False  # or restoring, which a failure is then of
    try:
        with contextlib.closing(fmu.reopened()) as trial:
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
            saving = True
            state, _ = (trial.save(), read())  # a process of its own answers only when it is read
            saving, once = False, passed(STEPS)
            saving = True
            trial.restore(state)
            read()
            saving, again = False, passed(STEPS)
            trial.release(state)
    except (FmuError, StepFailed):
        return not saving  # any other error is reported by the run itself
    allowed = SAME * np.abs(once).max(axis=0, initial=0.0)
    return bool(np.all((np.abs(again - once) <= allowed) | ~np.isfinite(once)))


class Sampled(Wrapped):
    """A digital controller, stepped every `period` [s] for any steps of its master.

    At each sample it gets the signals and makes a step as long as the sampling period. Its outputs
    after this step are applied from the sample on, and held until the next one. The instance is not
    initialized yet.
    """

    steps_vary = True  # the steps of the master are not those of the FMU

    _instance: Stepped

    def __init__(self, instance: Stepped, period: float) -> None:
        super().__init__(instance)
        self.sample_time, self.can_save = period, instance.can_save
        # a feedback law between samples is not applied by a digital controller
        law = law_ports(instance.outputs, instance.outputs, instance.inputs)
        self.outputs = [name for name in instance.outputs if name not in law]
        self._initialized, self._samples = False, 0
        self._given: dict[Writer, Vector] = {}

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """As for the FMU itself, but the stop time is the end of a period."""
        last = math.ceil(stop / self.sample_time - CLOSE) * self.sample_time
        self._instance.enter_initialization(values, last)

    def leave_initialization(self) -> None:
        self._instance.leave_initialization()
        self._initialized = True

    def writer(self, names: Sequence[str]) -> Writer:
        write = self._instance.writer(names)

        def keep(values: Vector) -> None:
            if not self._initialized:
                write(values)
                return
            self._given.pop(write, None)  # the last written values are passed on last
            self._given[write] = np.array(values, dtype=float)

        return keep

    def step(self, t: float, h: float) -> None:
        period = self.sample_time
        while self._samples * period < t + h - CLOSE * period:
            for write, values in self._given.items():
                write(values)
            self._instance.step(self._samples * period, period)
            self._samples += 1

    def save(self) -> Any:
        return self._instance.save(), self._samples, dict(self._given)

    def restore(self, state: Any) -> None:
        inner, self._samples, given = state
        self._given = dict(given)
        self._instance.restore(inner)

    def release(self, state: Any) -> None:
        self._instance.release(state[0])

    def reopened(self) -> Sampled:
        other = Sampled(self._instance.reopened(), self.sample_time)
        other.can_save = self.can_save
        return other
