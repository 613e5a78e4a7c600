"""One closed loop of a study, in one solver or with an FMU as controller, on a grid of times.

Some runs of a study are repeated over FMUs, for comparison.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from ...solver import core
from ...solver.kernel import CONTROLLER, DEFAULT_TOLERANCE, PLANT, Kernel, Model
from ...solver.signals import Parameter
from ..fmu.fmu_instance import StepFailed
from ..loop.closed_loop import run_closed_loop
from ..loop.joined import joined_pair
from ..loop.loop import Loop
from ..loop.whole_loop import follow
from ..master.reference_signal import Reference

if TYPE_CHECKING:
    from .plan import Duty

Vector = npt.NDArray[np.float64]

STEP = 1e-3  # s, of the grid of a loop that is not sampled
TOLERANCE = 1e-6
_SYSTEMS: dict[str, core.System] = {}  # a process runs a loop many times, one run after another


@dataclass(frozen=True)
class Course:
    """A run of a loop, on its grid of m times."""

    time: Vector  # shape (m,); [s]
    # shape (m,); [m], [m/s], [A], in the unit of the plant's command, [m], [m/s]. The current is
    # NaN for a plant without a current
    position: Vector
    velocity: Vector
    current: Vector
    command: Vector
    reference: Vector
    reference_velocity: Vector
    stopped: str = ""  # why it ended early; empty if it did not


@dataclass(frozen=True)
class StudyLoop:
    """A plant and a controller as one system of equations, see `loop_kernel`."""

    kernel: Kernel = field(repr=False)

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Of both parts, with the prefixes of a loop's parts."""
        return self.kernel.parameters

    @property
    def digest(self) -> str:
        """Of its equations and of the files of its FMUs."""
        return self.kernel.module

    def run(
        self,
        values: Mapping[str, float],
        reference: Reference,
        stop: float,
        tolerance: float = TOLERANCE,
    ) -> Course:
        """Run from rest for a time [s]; the grid is that of a sampled controller, else `STEP`.

        `values` are parameters that differ from their defaults, with the prefixes of a loop's
        parts. Over FMUs a finer tolerance than usual halves the master's steps. Raises KeyError for
        a parameter that does not exist.
        """
        module = self.kernel.module
        system = _SYSTEMS.get(module) or _SYSTEMS.setdefault(module, self.kernel.system())
        model = Model(self.kernel, values, tolerance, system)
        step = model.sample_time or STEP
        time = np.arange(math.ceil(stop / step - 1e-9) + 1, dtype=np.float64) * step
        x_d, v_d = reference.on(time, 0), reference.on(time, 1)
        y, stopped = follow(model, reference, time)
        if stopped:
            y = dict.fromkeys("xviu", np.zeros(0))
        current = y.get("i", np.full(len(time), np.nan))  # a plant driven by a force has none
        return Course(time, y["x"], y["v"], current, y["u"], x_d, v_d, stopped)


@dataclass(frozen=True)
class FmuLoop:
    """A loop with an FMU as controller: both parts are FMUs, coupled by the master.

    A digital controller has its sampling period in the `Loop`.
    """

    loop: Loop

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        sides = (PLANT, self.loop.plant), (CONTROLLER, self.loop.controller)
        return tuple(
            replace(p, name=side + n) for side, part in sides for n, p in part.parameters.items()
        )

    @property
    def digest(self) -> str:
        digest = hashlib.sha256(self.loop.controller.fmu().read_bytes()).hexdigest()
        return self.loop.plant.kernel.module + digest

    def run(
        self,
        values: Mapping[str, float],
        reference: Reference,
        stop: float,
        tolerance: float = TOLERANCE,
    ) -> Course:
        step = self.loop.sampled or (STEP if tolerance >= TOLERANCE else 0.5 * STEP)
        count = math.ceil(stop / step - 1e-9)
        loop = replace(
            self.loop,
            reference=reference,
            stop=count * step,
            plant_values=of_side(PLANT, values),
            controller_values=of_side(CONTROLLER, values),
        )
        try:
            with joined_pair(loop) as joined:
                found = joined.run_at(loop, step, look_again=False)
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


AnyLoop: TypeAlias = StudyLoop | FmuLoop


def of_side(side: str, values: Mapping[str, float]) -> dict[str, float]:
    """The values of one part of a loop, by the part's own names."""
    return {n.removeprefix(side): v for n, v in values.items() if n.startswith(side)}


SHARE = 20  # one run in this many, drawn at random
ALLOWED = 10.0  # times the effect of units in the last place, or of a tenth of the tolerance
TRUSTED = "trusted"  # the master's verdict on a coupling that converged
ROUND_OFF = 1e-13  # m, of positions in the size of a metre
COMPARED = ("rms_error", "peak_error", "failed")
"""Figures of a run that the table has; two runs' errors differ by no more than their positions."""
TOLERANCES = 40  # number of tolerances for the repetition of a run that seems to differ


@dataclass(frozen=True)
class FmuCheck:
    """One run over FMUs, compared with that of the study."""

    apart: float  # largest distance of the two positions [m]
    # ten times the uncertainty of the study's own run [m]: its largest change by one unit in the
    # last place of any parameter of the plant, by a tenth of the solver's tolerance, or by that of
    # the FMUs' own solvers; if that is less than `apart`, also by tolerances in between. At least
    # the master's own estimate of its coupling error
    allowed: float
    agrees: bool  # whether the position is that near, and the figures of the table agree
    # the master's verdict on its coupling; empty if the study's own run failed
    coupling: str = ""
    reason: str = ""  # reason of this verdict


def check_over_fmus(
    loop: AnyLoop,
    fmus: tuple[str, str],
    values: Mapping[str, float],
    duty: Duty,
    tolerance: float,
    table: Mapping[str, float],
) -> FmuCheck:
    """Run one loop over FMUs and compare.

    `fmus` are the paths of plant and controller, `values` by the loop's names, `tolerance` and
    `table`, the figures `COMPARED`, those of the study's run.
    """
    reference = duty.signal()
    own = loop.run(values, reference, duty.stop, tolerance)
    if own.stopped:  # a failed run is reported as such already
        return FmuCheck(math.nan, math.nan, bool(table["failed"]))

    def moved(others: Iterable[tuple[Mapping[str, float], float]]) -> float:
        runs = (loop.run(v, reference, duty.stop, t) for v, t in others)
        apart_of = (np.abs(o.position - own.position).max() for o in runs if not o.stopped)
        return float(max(apart_of, default=math.inf))

    # all of them: one alone may by chance leave every count of an encoder unchanged
    finest = min(tolerance / 10, DEFAULT_TOLERANCE)  # the latter is the FMUs' own
    finer = ((values, t) for t in {tolerance / 10, finest})
    uncertain = moved(chain(((v, tolerance) for v in _nearest(loop, values)), finer))
    stop, step = float(own.time[-1]), float(own.time[1])
    over = Loop(
        controller=fmus[1],
        plant=fmus[0],
        reference=reference,
        stop=stop,
        step=step,
        plant_values=of_side(PLANT, values),
        controller_values=of_side(CONTROLLER, values),
        isolate=False,
    )
    found = run_closed_loop(over).run
    position = np.interp(own.time, found.time, found.outputs["x"])
    apart = float(np.abs(position - own.position).max())
    if apart > ALLOWED * uncertain:  # all of them may have no effect by chance
        between = np.geomspace(finest, tolerance, TOLERANCES)
        uncertain = max(uncertain, moved((values, float(t)) for t in between))
    allowed = ALLOWED * max(uncertain, ROUND_OFF)
    verdict = found.verdict
    allowed = max(allowed, float(verdict.error_estimate["x"]))
    error = own.reference - position
    figures = {"rms_error": np.sqrt(np.mean(error**2)), "peak_error": np.abs(error).max()}
    off = max(abs(table[name] - figure) for name, figure in figures.items())
    agrees = apart <= allowed and bool(off <= allowed)  # NaN is not
    return FmuCheck(apart, allowed, agrees, verdict.word, verdict.reason)


def _nearest(loop: AnyLoop, values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """Yield the values with one parameter of the plant after the other at its next number."""
    for p in loop.parameters:
        if p.name.startswith(PLANT):
            value = values.get(p.name, p.default)
            if value:
                yield {**values, p.name: float(np.nextafter(value, np.inf))}
