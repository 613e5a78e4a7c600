"""The motions that are asked for, one function for each."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..solver.files import write_atomically
from .drive import Drive
from .machine_reach import (
    MARGIN,
    USED,
    Reach,
    acceleration_to,
    columns,
    fastest_speed,
    force_to_spare,
    largest_friction,
)

Vector = npt.NDArray[np.float64]

COMMAND_FILE = "next_experiment.csv"
UNNAMED = "unexplained"
POSITION, COMMAND = "x_d", "u"
_ROWS = 1e-3  # shortest time between rows of a command file [s]
_RAMPS = 0.25  # of a stroke, for each of its ramps at most
_REST = 0.2  # between strokes [s]
_LONGEST_STROKE = 4.0  # at a speed of several [s]
_SAMPLES_A_PERIOD = 40
_COUNTS = 20.0  # of the encoder in the amplitude of a sine


@dataclass(frozen=True)
class Motion:
    """What the machine is asked to do, and what to record.

    Attributes
    ----------
    kind : str
    says : str
        With its numbers, a clause.
    reference : {"x_d", "u"}
        What `values` are: the position that its controller follows [m], or the command without a
        controller, in the unit of the records.
    time, values : ndarray, shape (n,)
        Rows of the command file, from rest to rest.
    amplitude : float
        Half of what is between the smallest and the largest value.
    speeds : tuple of float
        Steady or largest speeds, all both ways [m/s]; none where the command is given.
    record : tuple of str
        Columns, with our names.
    sampling : float
        Interval at which to record, at most [s].
    """

    kind: str
    says: str
    reference: str
    time: Vector
    values: Vector
    amplitude: float
    speeds: tuple[float, ...]
    record: tuple[str, ...]
    sampling: float

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.time[-1])

    def to_dict(self) -> dict[str, Any]:
        """What `diagnosis.json` says of it."""
        return {
            "kind": self.kind,
            "says": self.says,
            "reference": self.reference,
            "amplitude": self.amplitude,
            "speeds_m_per_s": list(self.speeds),
            "start": float(self.values[0]),
            "duration_s": self.duration,
            "record": list(self.record),
            "sampling_s": self.sampling,
            "file": COMMAND_FILE,
        }

    def save(self, folder: Path) -> None:
        """Write ``next_experiment.csv``: ``time`` [s] and ``x_d`` [m] or ``u``.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        stream = io.StringIO()
        table = np.column_stack([self.time, self.values])
        header = f"time,{self.reference}"
        np.savetxt(stream, table, fmt="%.9g", delimiter=",", header=header, comments="")
        write_atomically(folder / COMMAND_FILE, stream.getvalue().encode())


# -- positions -------------------------------------------------------------------------------


def _stroke(way: float, speed: float, acceleration: float, rows: float) -> Vector:
    """Positions of one stroke from rest to rest, from its start, shape (n,) [m].

    It takes whole rows; speed and acceleration are at most those given.
    """
    speed = min(speed, math.sqrt(abs(way) * acceleration))
    ramp, whole = speed / acceleration, abs(way) / speed + speed / acceleration
    n = max(math.ceil(whole / rows), 2)
    t = np.linspace(0.0, whole, n + 1)  # n rows last longer than that: all is a little slower
    late = whole - t
    up, down = 0.5 * acceleration * t**2, abs(way) - 0.5 * acceleration * late**2
    steady = speed * (t - 0.5 * ramp)
    along = np.where(t < ramp, up, np.where(late < ramp, down, steady))
    return np.asarray(math.copysign(1.0, way) * along[1:])


def _strokes(
    start: float, moves: Sequence[tuple[float, float]], acceleration: float, rows: float
) -> Vector:
    """Positions of moves (place, speed) one after another, with rests between, shape (n,) [m]."""
    rest = round(_REST / rows)
    parts = [np.full(rest + 1, start)]
    here = start
    for place, speed in moves:
        parts.append(here + _stroke(place - here, speed, acceleration, rows))
        parts.append(np.full(rest, place))
        here = place
    return np.concatenate(parts)


def _rows(reach: Reach) -> float:
    return max(reach.step, _ROWS)


def _ends(reach: Reach) -> tuple[float, float]:
    return reach.low + MARGIN * reach.travel, reach.high - MARGIN * reach.travel


def _rampable(reach: Reach, model: Drive) -> tuple[float, float]:
    """The fastest speed that ramps leave most of the travel for, and the acceleration, SI."""
    speed = fastest_speed(reach, model)
    acceleration = acceleration_to(reach, model, speed)
    low, high = _ends(reach)
    return min(speed, math.sqrt(2.0 * _RAMPS * (high - low) * acceleration)), acceleration


def _positions(
    kind: str,
    says: str,
    reach: Reach,
    values: Vector,
    speeds: Sequence[float],
    record: tuple[str, ...],
) -> Motion:
    start, low, high = (_mm(float(x)) for x in (values[0], values.min(), values.max()))
    says = f"{says}; from x = {start}, between {low} and {high}"
    return _motion(kind, says, reach, POSITION, values, record, speeds)


def _motion(
    kind: str,
    says: str,
    reach: Reach,
    reference: str,
    values: Vector,
    record: tuple[str, ...],
    speeds: Sequence[float] = (),
) -> Motion:
    time: Vector = np.asarray(np.arange(len(values)) * _rows(reach), dtype=float)
    every = f"every {1e3 * reach.step:.3g} ms or faster"
    says += f", {time[-1]:.3g} s; record {', '.join(record)} {every}"
    size = 0.5 * float(np.ptp(values))
    return Motion(kind, says, reference, time, values, size, tuple(speeds), record, reach.step)


def _at_speeds(kind: str, reach: Reach, model: Drive, shares: Vector) -> Motion:
    """Strokes to and fro at shares of the fastest speed, each of a few seconds."""
    fastest, acceleration = _rampable(reach, model)
    low, high = _ends(reach)
    speeds = [float(fastest * share) for share in shares]
    moves = []
    for speed in speeds:
        way = min(high - low, speed * _LONGEST_STROKE)
        moves += [(low + way, speed), (low, speed)]
    says = (
        f"{len(speeds)} constant speeds from {_mm(speeds[0])}/s to {_mm(speeds[-1])}/s, "
        "each both ways"
    )
    values = _strokes(low, moves, acceleration, _rows(reach))
    return _positions(kind, says, reach, values, speeds, columns(model))


def constant_speeds(reach: Reach, model: Drive) -> Motion:
    return _at_speeds("constant speeds", reach, model, np.linspace(0.1, 1.0, 7))


def low_speeds(reach: Reach, model: Drive) -> Motion:
    return _at_speeds("low constant speeds", reach, model, np.geomspace(0.01, 0.5, 10))


def _to_and_fro(
    kind: str, reach: Reach, model: Drive, share: float, lasts: float, more: tuple[str, ...]
) -> Motion:
    """The whole travel, there and back, at one share of the fastest speed, for so long at least."""
    fastest, acceleration = _rampable(reach, model)
    low, high = _ends(reach)
    speed = share * fastest
    once = 2 * ((high - low) / speed + speed / acceleration + _REST)
    times = max(2, math.ceil(lasts / once))
    moves = [(high, speed), (low, speed)] * times
    says = f"{times} times there and back at {_mm(speed)}/s over the travel"
    values = _strokes(low, moves, acceleration, _rows(reach))
    return _positions(kind, says, reach, values, (speed,), columns(model, *more))


def slow_travel(reach: Reach, model: Drive) -> Motion:
    """Slow enough that the place is what changes, and no stroke takes more than half a minute."""
    low, high = _ends(reach)
    fastest, _ = _rampable(reach, model)
    share = min(max(0.05, (high - low) / 30.0 / fastest), 1.0)
    return _to_and_fro("slow strokes over the travel", reach, model, share, 0.0, ())


def again_and_again(reach: Reach, model: Drive, more: tuple[str, ...] = ()) -> Motion:
    """The same for minutes; `more` are columns to be recorded beside."""
    lasts = min(max(3.0 * reach.lasts, 60.0), 600.0)
    return _to_and_fro("one speed, again and again", reach, model, 0.5, lasts, more)


def highest_speed(reach: Reach, model: Drive) -> Motion:
    return _to_and_fro("strokes at the highest speed", reach, model, 1.0, 10.0, ())


def slow_reversals(reach: Reach, model: Drive) -> Motion:
    """Short strokes to and fro at five places."""
    fastest, acceleration = _rampable(reach, model)
    low, high = _ends(reach)
    way = 0.1 * (high - low)
    speed = max(0.05 * fastest, min(0.5 * way, fastest))
    moves = []
    for place in np.linspace(low, high - way, 5):
        there = [(float(place + way), speed), (float(place), speed)]
        moves += [(float(place), speed), *there * 3]
    moves = [*moves[1:], (low, speed)]
    says = f"strokes of {_mm(way)} to and fro at {_mm(speed)}/s, three at each of five places"
    values = _strokes(low, moves, acceleration, _rows(reach))
    return _positions("slow reversals", says, reach, values, (speed,), columns(model))


def sines(reach: Reach, model: Drive) -> Motion:
    """Three sines of one largest speed and three accelerations, about the middle of the travel."""
    low, high = _ends(reach)
    peak = 0.5 * fastest_speed(reach, model)
    rows = _rows(reach)
    spare = 0.8 * (force_to_spare(reach, model) - model.damping * peak) / model.inertia
    hardest = spare if spare > 0.0 else reach.acceleration
    fastest = min(hardest / (2 * math.pi * peak), 1.0 / (_SAMPLES_A_PERIOD * rows))
    if reach.resolution:
        fastest = min(fastest, peak / (2 * math.pi * _COUNTS * reach.resolution))
    fastest = max(fastest, peak / (math.pi * (high - low)))  # else it does not fit the travel
    parts, speeds, frequencies = [np.zeros(1)], [], []
    for share in (0.25, 0.5, 1.0):
        f = share * fastest
        size = min(peak / (2 * math.pi * f), 0.5 * (high - low))
        periods = max(10, round(4.0 * f))
        t = rows * np.arange(1, round(periods / f / rows) + 1)
        envelope = np.clip(np.minimum(t, periods / f - t) * f / 2.0, 0.0, 1.0)
        parts.append(size * envelope * np.sin(2 * math.pi * f * t))
        speeds.append(2 * math.pi * f * size)
        frequencies.append(f)
    values = 0.5 * (low + high) + np.concatenate(parts)
    told = ", ".join(f"{f:.3g}" for f in frequencies)
    says = (
        f"sines of {told} Hz, of the same largest speed of {_mm(speeds[-1])}/s and so of "
        "different accelerations"
    )
    return _positions("sines", says, reach, values, speeds, columns(model))


# -- commands --------------------------------------------------------------------------------


def _commands(
    kind: str, says: str, reach: Reach, values: Vector, record: tuple[str, ...]
) -> Motion:
    says += (
        ", without a controller, each row held until the next; from rest in the middle of the "
        "travel"
    )
    return _motion(kind, says, reach, COMMAND, values, record)


def staircase(reach: Reach, model: Drive) -> Motion:
    """Levels of the command up to nine tenths of what slides, both ways, twice."""
    least = 0.9 * model.friction_scale / abs(model.per_command)
    size = min(least, USED * reach.command)
    once = np.concatenate([np.arange(0, 10), np.arange(10, -10, -1), np.arange(-10, 0)])
    levels = np.concatenate([once, once, [0]]) / 10.0
    values = size * np.repeat(levels, round(0.5 / _rows(reach)))
    says = (
        f"a staircase of the command to {size:.3g} and {-size:.3g} and back, twice, below "
        "break-away, half a second a step"
    )
    return _commands("slow staircase of the command", says, reach, values, columns(model))


def steps(reach: Reach, model: Drive) -> Motion:
    """Steps of the command from rest, both ways in turn, each over a tenth of the travel."""
    speed = min(0.5 * reach.speed, fastest_speed(reach, model))
    wanted = (largest_friction(model) + model.damping * speed) / abs(model.per_command)
    size = min(
        max(wanted, 1.1 * largest_friction(model) / abs(model.per_command)), USED * reach.command
    )
    rows = _rows(reach)
    held = max(round(min(0.1 * reach.travel / speed, 0.5) / rows), 10)
    pattern = np.repeat([0.0, size, 0.0, -size], held)
    values = np.concatenate([np.tile(pattern, 10), np.zeros(held)])
    says = f"steps of the command to {size:.3g} and {-size:.3g}, ten of each, {held * rows:.3g} s"
    return _commands("steps of the command", says, reach, values, columns(model))


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"
