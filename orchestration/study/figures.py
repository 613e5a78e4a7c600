"""Figures of merit of one run of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from ...plant.instruments import UNLIMITED
from ...solver.kernel import PLANT
from ..loop.catalogue import LIMIT
from ..loop.closed_loop import BAND, Vector, overshoot, settled_from
from ..master.reference_signal import Reference
from .loop import AnyLoop, Course

MICRON = 1e-6
COUNTS = 10
AFTER_REVERSAL = 0.05  # s, time after a reversal of the set-point for the reversal error
AT_REST = 0.25  # last share of the rest after a motion, which is checked for hunting
CYCLES = 2  # fewest cycles in it that are called hunting


@dataclass(frozen=True)
class Figures:
    """Figures of merit of a run; NaN if the run does not define one, or failed."""

    rms_error: float  # set-point minus position [m]
    peak_error: float
    # from the end of the last motion until the error stays within 2 % of the set-point's range, 1
    # um, 10 counts [s]; infinite if it does not
    settling_2pct: float
    settling_1um: float
    settling_10counts: float
    overshoot: float  # furthest beyond the range of the set-point [m]
    reversal_error: float  # largest error within 50 ms after the set-point reverses [m]
    energy: float  # energy from the amplifier, which takes none back [J]
    total_variation: float  # sum of the magnitudes of all changes of the command [V]
    saturated_share: float  # share of the time in which the command is at the amplifier's limit
    peak_current: float  # [A]
    # half the range of the position in the last quarter of the last rest [m], and its period [s];
    # zero and NaN if there are fewer than two whole cycles in it
    hunting_amplitude: float
    hunting_period: float
    # 1 if it hunts there: two oscillations or more, with an amplitude of more than a count of the
    # position sensor. 0 if it does not: it stays within a count. NaN if this cannot be decided: it
    # creeps, oscillates by less than a count, or there is no rest
    hunting: float
    steady_error: float  # mean error there [m]
    failed: float = 0.0  # 1 if the solver could not continue


NAMES = tuple(f.name for f in fields(Figures))
UNITS = dict(
    zip(
        NAMES,
        ["m", "m", "s", "s", "s", "m", "m", "J", "V", "1", "A", "m", "s", "1", "m", "1"],
        strict=True,
    )
)


SIZES = ("rms_error", "peak_error", "reversal_error", "energy", "total_variation", "peak_current")
"""Figures that are positive, except without any motion, and that plants change by factors."""


def hunting_verdict(hunting: float) -> str:
    """The value of `Figures.hunting` in words."""
    if math.isnan(hunting):
        return "undecided"
    return "hunting" if hunting else "none"


def measured(
    loop: AnyLoop,
    values: Mapping[str, float],
    motion: tuple[Reference, float],
    tolerance: float,
    count: float,
) -> tuple[Course, Figures]:
    """Run a loop with these values over a motion and its length [s]; the run and its figures."""
    course = loop.run(values, *motion, tolerance)
    return course, figures_of(course, count, values.get(PLANT + LIMIT, UNLIMITED))


def figures_of(course: Course, count: float, limit: float) -> Figures:
    """The figures of a run, with the sensor's resolution [m] and the limit of the command."""
    if course.stopped or not np.isfinite(course.position).all():
        return Figures(**dict.fromkeys(NAMES, math.nan) | {"failed": 1.0})
    time, error = course.time, course.reference - course.position
    step = time[1] - time[0]
    moves = np.flatnonzero(np.abs(np.diff(course.reference)) > 0)
    end = int(moves[-1]) + 1 if len(moves) else 0  # the set-point rests from here on
    low, high = min(course.reference.min(), 0.0), max(course.reference.max(), 0.0)
    rest = slice(end + math.ceil((1 - AT_REST) * (len(time) - end)), None)
    rests = len(time[rest]) >= 2 * CYCLES
    amplitude, period = _hunting(course.position[rest], step) if rests else (0.0, math.nan)
    power = np.maximum(course.command * course.current, 0.0)
    return Figures(
        rms_error=float(np.sqrt(np.mean(error**2))),
        peak_error=float(np.abs(error).max()),
        settling_2pct=_settled(time, error, BAND * (high - low), end),
        settling_1um=_settled(time, error, MICRON, end),
        settling_10counts=_settled(time, error, COUNTS * count, end),
        overshoot=overshoot(course.position, low, high),
        reversal_error=_after_reversals(course, error, step),
        energy=float(np.sum(power[:-1]) * step),
        total_variation=float(np.abs(np.diff(course.command)).sum()),
        saturated_share=float(np.mean(np.abs(course.command) >= limit * (1 - 1e-9))),
        peak_current=float(np.abs(course.current).max()),
        hunting_amplitude=amplitude,
        hunting_period=period,
        hunting=_hunts(course.position[rest], amplitude, count) if rests else math.nan,
        steady_error=float(np.mean(error[rest])) if rests else math.nan,
    )


def _settled(time: Vector, error: Vector, band: float, end: int) -> float:
    k = settled_from(error[end:], band)
    return math.inf if k is None else float(time[end + k] - time[end])


def _after_reversals(course: Course, error: Vector, step: float) -> float:
    direction = np.sign(course.reference_velocity)
    moving = np.flatnonzero(direction)
    turns = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
    if not len(turns):
        return math.nan
    width = round(AFTER_REVERSAL / step)
    return float(max(np.abs(error[k : k + width + 1]).max() for k in turns))


def _hunting(position: Vector, step: float) -> tuple[float, float]:
    """Amplitude and period of an oscillating position, else zero and NaN."""
    middle = (position.max() + position.min()) / 2
    above = position > middle
    upward = np.flatnonzero(~above[:-1] & above[1:])
    size = float(np.ptp(position) / 2)
    if len(upward) <= CYCLES or size < 1e-10:
        return 0.0, math.nan
    return size, float((upward[-1] - upward[0]) * step / (len(upward) - 1))


def _hunts(position: Vector, amplitude: float, count: float) -> float:
    """See `Figures.hunting`; the amplitude is zero if there are too few cycles."""
    if np.ptp(position) <= count:
        return 0.0
    return 1.0 if amplitude > count else math.nan
