"""The trials of the thesis: the reference of each, also scaled to another machine.

Values that the text does not give (durations of force steps and constant velocities, the twenty
loading rates) are chosen here, and described in `Trial.note`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ...plant.instruments.acquisition import SAMPLE_TIME
from ...plant.lugre import PARAMETERS as FRICTION
from ...solver.arrays import Vector
from ...solver.component import unit_in
from ...solver.errors import BadParameter, did_you_mean
from .regulators import loading_voltage

VELOCITY, FORCE, VOLTAGE = "velocity", "force", "voltage"  # what a trial controls
BREAK_AWAY = next(p.default for p in FRICTION if p.name == "Fs")
"""Static friction of the thesis' axis [N], Table 3.1."""
FORCE_STEP_TIME, CONSTANT_VELOCITY_TIME = 10.0, 4.0  # s
RAMP_TO = 3.5
"""Quasi-static force at the end of a loading-rate trial [N]; the block breaks away earlier."""
LOADING_RATES = tuple(float(f"{0.08 * (20.3 / 0.08) ** (k / 19):.3g}") for k in range(20))
"""Twenty loading rates from 0.08 to 20.3 N/s, logarithmically spaced [N/s]."""

_SLOW = [round(1e-3 * (2.0 + 0.5 * k), 6) for k in range(8)]  # m/s
_FAST = [round(1e-3 * k, 6) for k in range(3, 9)]
FASTEST = _FAST[-1]
"""Largest velocity of the thesis' trials [m/s]."""
_DAHL = [(1.0, 3.15), (1 / 2, 6.3), (1 / 4, 12.6), (1 / 6, 19.0)]  # frequency [1/s], duration [s]
_BLIMAN_SORINE = [(2 / 3, 18.85), (4 / 5, 15.7), (1.0, 12.57)]
_FIFTEEN = "the text says fifteen trials, its list has sixteen; duration not printed: 4 s"
_REPEATED = "Section 2.4.1, five repetitions each; duration not printed: 4 s"
_RAMP = (
    "the thesis applies constant voltages; on a rigid drive this gives no constant loading "
    "rate, so the voltage is a ramp computed for the nominal stuck block; when the bristles "
    "yield, the force rises more slowly; rates between the first and the last are not printed"
)


@dataclass(frozen=True)
class Sizes:
    """Scaling of the trials of the thesis to a machine."""

    speed: float = 1.0  # its velocities, relative to the thesis
    force: float = 1.0  # its forces, relative to the thesis
    travel: float = math.inf  # longest motion [m]; the time of a longer one is shortened
    words: Mapping[str, str] = field(default_factory=dict)  # its units, see `unit_in`
    plates: bool = True  # whether it has the thesis' capacitance sensor
    loading: Callable[[float, Vector], Vector] = loading_voltage  # command for a rate [N/s]

    def shorter(self, way: float) -> float:
        """Factor on the thesis' time for a motion of this length [m]."""
        return min(1.0, self.travel / abs(way)) if way else 1.0

    def says(self, velocity: float) -> str:
        unit = unit_in("m/s", self.words)
        return f"{1e3 * velocity:.4g} mm/s" if unit == "m/s" else f"{velocity:.4g} {unit}"

    def says_force(self, force: float, per: str = "") -> str:
        return f"{force:.4g} {unit_in('N', self.words)}{per}"


@dataclass(frozen=True)
class Trial:
    """One trial."""

    name: str  # such as 2.4/7
    table: str  # its table or series
    number: int  # in the table, starting at 1
    control: str  # controlled quantity; for "voltage" the command is given directly
    asked: str  # the reference in words
    duration: float  # s
    course: Callable[[Vector], Vector] = field(repr=False, compare=False)
    """The reference over an array of times [m/s, N or V]."""
    fine: bool = False  # whether the capacitance sensor is used
    note: str = ""  # what the thesis does not specify, and the choice made here
    level: float = 0.0
    """What distinguishes the trials of a series: force [N], peak velocity [m/s], rate [N/s]."""

    @property
    def folder(self) -> str:
        """The name as a folder name, such as ``2.4-07``, in the order of the trials."""
        return f"{self.table}-{self.number:02d}"

    @property
    def samples(self) -> int:
        """Number of samples, the first at t = 0."""
        return round(self.duration / SAMPLE_TIME) + 1

    @property
    def time(self) -> Vector:
        """Sample instants [s]."""
        return np.asarray(np.arange(self.samples) * SAMPLE_TIME, dtype=np.float64)

    def reference(self) -> Vector:
        """The reference at the sample instants."""
        return np.asarray(self.course(self.time), dtype=float)

    def line(self) -> str:
        """One line for a list."""
        sensor = ", capacitance sensor" if self.fine else ""
        return f"{self.name:<16}{self.asked}, {self.duration:g} s{sensor}"


# -- the reference of each kind of trial: what it is in words, its duration, its course -----------


def _constant(value: float, t: Vector) -> Vector:
    return np.full(len(t), value)


def _force_step(size: Sizes, force: float, fine: bool = False) -> dict[str, Any]:
    force = size.force * force
    return {
        "control": FORCE,
        "asked": f"step of the force to {size.says_force(force)}",
        "duration": FORCE_STEP_TIME,
        "course": partial(_constant, force),
        "fine": fine and size.plates,
        "note": "duration not printed: 10 s",
        "level": force,
    }


def _constant_velocity(size: Sizes, velocity: float, note: str) -> dict[str, Any]:
    velocity = size.speed * velocity
    return {
        "control": VELOCITY,
        "asked": f"constant velocity {size.says(velocity)}",
        "duration": CONSTANT_VELOCITY_TIME * size.shorter(CONSTANT_VELOCITY_TIME * velocity),
        "course": partial(_constant, velocity),
        "note": note,
        "level": velocity,
    }


def _oscillating(mean: float, swing: float, omega: float, t: Vector) -> Vector:
    return np.asarray(mean + swing * np.sin(omega * t))


def _sine(size: Sizes, swing: float, omega: float, end: float, mean: float = 0.0) -> dict[str, Any]:
    way = end * mean * size.speed if mean else 2 * (size.speed * swing) / omega
    share = size.shorter(way)
    swing, omega, mean = size.speed * swing, omega / share, size.speed * mean
    offset = f"{size.says(mean)} + " if mean else ""
    return {
        "control": VELOCITY,
        "asked": f"velocity {offset}{size.says(swing)} sin({omega:.4g} t)",
        "duration": share * end,
        "course": partial(_oscillating, mean, swing, omega),
        "level": swing,
    }


def _loading(size: Sizes, rate: float) -> dict[str, Any]:
    nominal = size.loading is loading_voltage
    what, level = "voltage" if nominal else "command", size.force * rate
    return {
        "control": VOLTAGE,
        "asked": f"{what} ramp that loads the block at {size.says_force(level, '/s')}",
        "duration": math.ceil((RAMP_TO / rate + 0.5) / SAMPLE_TIME) * SAMPLE_TIME,
        "course": partial(size.loading, level),
        "note": _RAMP if nominal else "",
        "level": level,
    }


def _climbing(force: float, t: Vector) -> Vector:
    """Fig. 2.13: 2 s of zero force, then three times 2 s of 0.25 N/s and a hold of 3 s."""
    times = (0.0, 2.0, 4.0, 7.0, 9.0, 12.0, 14.0, 17.0)
    return np.asarray(force * np.interp(t, times, (0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.5, 1.5)))


def _staircase(size: Sizes) -> dict[str, Any]:
    low, middle = (f"{f * size.force:.4g}" for f in (0.5, 1.0))
    highest = 1.5 * size.force
    return {
        "control": FORCE,
        "asked": f"staircase of the force to {low}, {middle} and {size.says_force(highest)} "
        "(Fig. 2.13)",
        "duration": 17.0,
        "course": partial(_climbing, size.force),
        "fine": size.plates,
        "level": highest,
    }


def trials_of(size: Sizes) -> dict[str, Trial]:
    """All trials by name, scaled to a machine."""
    swings = [(2e-3, row) for row in _BLIMAN_SORINE]
    swings += [(a, _BLIMAN_SORINE[0]) for a in (3e-3, 4e-3, 5e-3)]
    swings += [(6e-3, row) for row in _BLIMAN_SORINE]
    forces = (0.3, 0.6, 1.0, 1.5, 1.8, 2.0, 2.1, 2.2, -0.3, -0.6, -2.1, -2.3, -2.4)  # N
    steps = [_force_step(size, f) for f in forces]
    repeated = [v for speed in _FAST for v in [speed] * 5 + [-speed] * 5]
    tables = {
        "2.2": steps,
        "2.3.1": [_constant_velocity(size, s * v, _FIFTEEN) for s in (1, -1) for v in _SLOW],
        "2.4": [_sine(size, s * 1e-3, *row) for s in (1, -1) for row in _DAHL for _ in range(2)],
        "2.6": [_sine(size, a, *row) for a, row in swings],
        "2.8": [_force_step(size, f, fine=True) for f in (0.5, 0.5, 1.0, 1.0, 1.5, 1.5)],
        "2.10": steps,
        "2.11": [_sine(size, 1e-3, 3.0, 18.85, mean=1.5e-3)],
        "viscous": [_constant_velocity(size, v, _REPEATED) for v in repeated],
        "loading-rate": [_loading(size, rate) for rate in LOADING_RATES],
        "presliding": [_staircase(size)],
    }
    return {
        f"{table}/{k}": Trial(f"{table}/{k}", table, k, **row)
        for table, rows in tables.items()
        for k, row in enumerate(rows, start=1)
    }


TRIALS: dict[str, Trial] = trials_of(Sizes())
TABLES: tuple[str, ...] = tuple(dict.fromkeys(t.table for t in TRIALS.values()))
PRESLIDING: tuple[str, ...] = ("2.8", "presliding")
"""Tables and series about displacements before break-away."""


def trials_named(name: str, trials: Mapping[str, Trial] = TRIALS) -> list[Trial]:
    """The trial of this name, or all trials of a table.

    ``2.4/7``, ``table-2.4-7`` and ``2.4-7`` are the same; ``2.4`` means all trials of Table 2.4; a
    series of one trial, such as ``presliding``, needs no number. Raises BadParameter.
    """
    plain = name.strip().removeprefix("table-")
    if plain in TABLES:
        return [t for t in trials.values() if t.table == plain]
    table, _, number = plain.replace("/", "-").rpartition("-")
    if number.isdecimal() and f"{table}/{int(number)}" in trials:
        return [trials[f"{table}/{int(number)}"]]
    if table in TABLES:
        count = sum(t.table == table for t in TRIALS.values())
        raise BadParameter(f"no trial {name!r}: {table} has trials 1 to {count}")
    hint = did_you_mean(plain, TRIALS if "/" in plain else TABLES)
    raise BadParameter(
        f"no trial {name!r}; there are {', '.join(TABLES)}, or one trial as in 2.4/7{hint}"
    )
