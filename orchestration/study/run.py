"""One run of a study: a loop in one solver or with an FMU as controller, and its figures of merit.

Some runs of a study are repeated over FMUs, for comparison.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from ...solver import core
from ...solver.arrays import Vector
from ...solver.kernel import CONTROLLER, DEFAULT_TOLERANCE, PLANT, Kernel, Model
from ...solver.signals import Parameter
from ..fmu.fmu_instance import StepFailed
from ..loop.closed_loop import BAND, overshoot, run_closed_loop, settled_from
from ..loop.loop import Loop
from ..loop.system import joined
from ..loop.whole_loop import follow
from ..master.reference_signal import Reference

Values: TypeAlias = Mapping[str, float]  # not default ones, with the prefixes of a loop's parts
Motion: TypeAlias = tuple[Reference, float]  # a set-point over time, and the length of its run [s]

STEP = 1e-3  # s, of the grid of a loop that is not sampled
TOLERANCE = 1e-6
_SYSTEMS: dict[str, core.System] = {}  # a process runs a loop many times, one run after another


@dataclass(frozen=True)
class Course:
    """A run of a loop, on its grid of m times; without signals if it ended early."""

    time: Vector  # shape (m,); [s]
    reference: Vector  # [m]
    reference_velocity: Vector  # [m/s]
    position: Vector  # [m]
    velocity: Vector  # [m/s]
    current: Vector  # [A]; NaN for a plant without one
    command: Vector  # in its unit
    stopped: str = ""  # why it ended early; empty if it did not

    @classmethod
    def of(
        cls, time: Vector, reference: Reference, signals: Mapping[str, Vector], stopped: str
    ) -> Course:
        """The run with the signals ``x``, ``v``, ``i`` and ``u``."""
        none = np.full(0 if stopped else len(time), np.nan)
        x, v, i, u = (none if stopped else signals.get(n, none) for n in "xviu")
        return cls(time, reference.on(time, 0), reference.on(time, 1), x, v, i, u, stopped)


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

    def run(self, values: Values, motion: Motion, tolerance: float = TOLERANCE) -> Course:
        """Run from rest; the grid is that of a sampled controller, else `STEP`.

        Over FMUs a finer tolerance than usual halves the master's steps. Raises KeyError for a
        parameter that does not exist.
        """
        reference, stop = motion
        module = self.kernel.module
        system = _SYSTEMS.get(module) or _SYSTEMS.setdefault(module, self.kernel.system())
        model = Model(self.kernel, values, tolerance, system)
        time = _grid(stop, model.sample_time or STEP)
        return Course.of(time, reference, *follow(model, reference, time))


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

    def run(self, values: Values, motion: Motion, tolerance: float = TOLERANCE) -> Course:
        reference, stop = motion
        step = self.loop.sampled or (STEP if tolerance >= TOLERANCE else 0.5 * STEP)
        time = _grid(stop, step)
        loop = self.loop.with_values(values)
        loop = replace(loop, reference=reference, stop=float(time[-1]))
        signals = {}
        try:
            with joined(loop) as both:
                found = both.run_at(step)
            stopped = found.stopped
            if not stopped:
                known = {**found.outputs, "u": found.commands["u"]}
                signals = {n: np.interp(time, found.time, known[n]) for n in "xviu" if n in known}
        except StepFailed as error:
            stopped = str(error)
        return Course.of(time, reference, signals, stopped)


AnyLoop: TypeAlias = StudyLoop | FmuLoop


def _grid(stop: float, step: float) -> Vector:
    return np.arange(math.ceil(stop / step - 1e-9) + 1, dtype=np.float64) * step


MICRON, COUNTS = 1e-6, 10  # bands of settling [m], [counts]
AFTER_REVERSAL = 0.05  # s, time after a reversal of the set-point for the reversal error
AT_REST = 0.25  # last share of the rest after a motion, which is checked for hunting
CYCLES = 2  # fewest cycles in it that are called hunting


class Figures(NamedTuple):
    """Figures of merit of a run; NaN if the run does not define one, or failed."""

    rms_error: float  # set-point minus position [m]
    peak_error: float
    settling_2pct: float  # from the end of the last motion until the error stays within 2 % of the
    settling_1um: float  # set-point's range, 1 um, 10 counts [s]; infinite if it does not
    settling_10counts: float
    overshoot: float  # furthest beyond the range of the set-point [m]
    reversal_error: float  # largest error within 50 ms after the set-point reverses [m]
    energy: float  # energy from the amplifier, which takes none back [J]
    total_variation: float  # sum of the magnitudes of all changes of the command [V]
    saturated_share: float  # share of the time in which the command is at the amplifier's limit
    peak_current: float  # [A]
    peak_command: float  # largest magnitude that the controller asks for [V]
    hunting_amplitude: float  # half the range of the position in the last quarter of the last rest
    hunting_period: float  # [m], [s]; zero and NaN if there are fewer than two whole cycles in it
    # 1 if it hunts there: two cycles or more of more than a count of the position sensor; 0 if it
    # stays within a count; NaN if it creeps, oscillates by less, or there is no rest
    hunting: float
    steady_error: float  # mean error there [m]
    failed: float = 0.0  # 1 if the solver could not continue


NAMES = Figures._fields
UNITS = dict(zip(NAMES, "m m s s s m m J V 1 A V m s 1 m 1".split(), strict=True))
JUDGED_BY = "rms_error"
MEASURED = tuple(n for n in NAMES if n not in ("hunting", "failed"))  # without verdicts
# figures that are positive, except without any motion, and that plants change by factors
SIZES = [JUDGED_BY, "peak_error", "reversal_error", "energy", "total_variation"]
SIZES += ["peak_current", "peak_command"]


def hunting_verdict(hunting: float) -> str:
    """The value of `Figures.hunting` in words."""
    if math.isnan(hunting):
        return "undecided"
    return "hunting" if hunting else "none"


def figures_of(course: Course, count: float, limit: float) -> Figures:
    """The figures of a run, with the sensor's resolution [m] and the limit of the command."""
    if course.stopped or not np.isfinite(course.position).all():
        return Figures(**dict.fromkeys(NAMES, math.nan) | {"failed": 1.0})
    time, error = course.time, course.reference - course.position
    step = time[1] - time[0]
    moves = np.flatnonzero(np.abs(np.diff(course.reference)) > 0)
    end = int(moves[-1]) + 1 if len(moves) else 0  # the set-point rests from here on
    low, high = min(course.reference.min(), 0.0), max(course.reference.max(), 0.0)

    def settling(band: float) -> float:
        k = settled_from(error[end:], band)
        return math.inf if k is None else float(time[end + k] - time[end])

    rest = slice(end + math.ceil((1 - AT_REST) * (len(time) - end)), None)
    amplitude = 0.0
    period = hunting = steady = math.nan
    if len(time[rest]) >= 2 * CYCLES:
        amplitude, period = _oscillation(course.position[rest], step)
        still = np.ptp(course.position[rest]) <= count
        hunting = 0.0 if still else 1.0 if amplitude > count else math.nan
        steady = float(np.mean(error[rest]))
    power = np.maximum(course.command * course.current, 0.0)
    return Figures(
        rms_error=float(np.sqrt(np.mean(error**2))),
        peak_error=float(np.abs(error).max()),
        settling_2pct=settling(BAND * (high - low)),
        settling_1um=settling(MICRON),
        settling_10counts=settling(COUNTS * count),
        overshoot=overshoot(course.position, low, high),
        reversal_error=_after_reversals(course, error, step),
        energy=float(np.sum(power[:-1]) * step),
        total_variation=float(np.abs(np.diff(course.command)).sum()),
        saturated_share=float(np.mean(np.abs(course.command) >= limit * (1 - 1e-9))),
        peak_current=float(np.abs(course.current).max()),
        peak_command=float(np.abs(course.command).max()),
        hunting_amplitude=amplitude,
        hunting_period=period,
        hunting=hunting,
        steady_error=steady,
    )


def _after_reversals(course: Course, error: Vector, step: float) -> float:
    direction = np.sign(course.reference_velocity)
    moving = np.flatnonzero(direction)
    turns = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
    width = round(AFTER_REVERSAL / step)
    return float(max((np.abs(error[k : k + width + 1]).max() for k in turns), default=math.nan))


def _oscillation(position: Vector, step: float) -> tuple[float, float]:
    """Amplitude and period of an oscillating position, else zero and NaN."""
    above = position > (position.max() + position.min()) / 2
    upward = np.flatnonzero(~above[:-1] & above[1:])
    size = float(np.ptp(position) / 2)
    if len(upward) <= CYCLES or size < 1e-10:
        return 0.0, math.nan
    return size, float((upward[-1] - upward[0]) * step / (len(upward) - 1))


ALLOWED = 10.0  # times the effect of other tolerances
TRUSTED = "trusted"  # the master's verdict on a coupling that converged
ROUND_OFF = 1e-13  # m, of positions in the size of a metre
OTHERS = 40  # tolerances of runs that show how much of a run is decided by round-off


@dataclass(frozen=True)
class FmuCheck:
    """One run over FMUs, compared with that of the study."""

    apart: float  # largest distance of the two positions [m]
    # ten times the uncertainty of the study's own run [m], its largest change by a finer tolerance,
    # down to that of the FMUs' own solvers; at least the master's estimate of its coupling error
    allowed: float
    agrees: bool  # whether the position is that near, and the figures of the table agree
    # the master's verdict on its coupling; empty if the study's own run failed
    coupling: str = ""
    reason: str = ""  # reason of this verdict


def check_over_fmus(
    loop: AnyLoop, over: Loop, motion: Motion, tolerance: float, table: Mapping[str, float]
) -> FmuCheck:
    """Run a loop also as the FMUs of `over`, with its values, and compare.

    `tolerance` and `table`, with the figures of the errors and `failed`, are those of the study's
    run.
    """
    values = over.values
    own = loop.run(values, motion, tolerance)
    if own.stopped:  # a failed run is reported as such already
        return FmuCheck(math.nan, math.nan, bool(table["failed"]))
    # many tolerances: one alone may by chance leave every count of an encoder unchanged
    finest = min(tolerance / 10, DEFAULT_TOLERANCE)  # the latter is the FMUs' own
    others = (loop.run(values, motion, float(t)) for t in np.geomspace(finest, tolerance, OTHERS))
    moved = (np.abs(o.position - own.position).max() for o in others if not o.stopped)
    uncertain = float(max(moved, default=math.inf))
    over = replace(over, reference=motion[0], stop=float(own.time[-1]), step=float(own.time[1]))
    found = run_closed_loop(over).run
    position = np.interp(own.time, found.time, found.outputs["x"])
    apart = float(np.abs(position - own.position).max())
    estimate = float(found.verdict.error_estimate["x"])
    allowed = max(ALLOWED * max(uncertain, ROUND_OFF), estimate)
    # two runs' errors differ by no more than their positions
    error = own.reference - position
    figures = {JUDGED_BY: np.sqrt(np.mean(error**2)), "peak_error": np.abs(error).max()}
    off = max(abs(table[name] - figure) for name, figure in figures.items())
    agrees = apart <= allowed and bool(off <= allowed)  # NaN is not
    return FmuCheck(apart, allowed, agrees, found.verdict.word, found.verdict.reason)
