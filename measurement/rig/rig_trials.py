"""The trials of the thesis: the reference of each, also scaled to another machine.

Values that the text does not give (durations of force steps and constant velocities, the twenty
loading rates) are chosen here, and described in `Trial.note`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import numpy.typing as npt

from ...plant.instruments.acquisition import SAMPLE_TIME
from ...solver.component import unit_in
from ...solver.errors import BadParameter, did_you_mean

Vector = npt.NDArray[np.float64]

VELOCITY, FORCE, VOLTAGE = "velocity", "force", "voltage"
FORCE_STEP_TIME = 10.0
CONSTANT_VELOCITY_TIME = 4.0
RAMP_TO = 3.5
"""Quasi-static force at the end of a loading-rate trial [N]; the block breaks away earlier."""


FASTEST, BREAK_AWAY = 8e-3, 2.35
"""Largest velocity of the thesis' trials [m/s], and static friction of its axis [N], Table 3.1."""


@dataclass(frozen=True)
class Sizes:
    """Scaling of the trials of the thesis to a machine.

    Attributes
    ----------
    speed, force : float
        Its velocities and forces, relative to the thesis.
    travel : float
        Longest allowed motion [m]; the time of a longer one is shortened.
    words : mapping of str to str
        Units of the machine, see `unit_in`.
    plates : bool
        Whether the machine has the thesis' capacitance sensor.
    loading : function of a rate and an array of times, optional
        Command that loads the machine at a rate [N/s, s]; by default that of the thesis' axis.
    """

    speed: float = 1.0
    force: float = 1.0
    travel: float = math.inf
    words: Mapping[str, str] = field(default_factory=dict)
    plates: bool = True
    loading: Callable[[float, Vector], Vector] | None = None

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
    """One trial.

    Attributes
    ----------
    name : str
        Such as ``2.4/7``.
    table : str
        Its table or series.
    number : int
        Number in the table, starting at 1.
    control : {"velocity", "force", "voltage"}
        Controlled quantity; for "voltage" the command is given directly.
    asked : str
        The reference in words.
    duration : float
        Duration [s].
    course : function of time
        The reference over an array of times [m/s, N or V].
    fine : bool
        Whether the capacitance sensor is used.
    note : str
        What the thesis does not specify, and the choice made here.
    level : float
        The number that distinguishes the trials of a series: force [N], peak velocity [m/s] or
        loading rate [N/s].
    """

    name: str
    table: str
    number: int
    control: str
    asked: str
    duration: float
    course: Callable[[Vector], Vector] = field(repr=False, compare=False)
    fine: bool = False
    note: str = ""
    level: float = 0.0

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


def _constant(value: float, t: Vector) -> Vector:
    return np.full(len(t), value)


def _sine(mean: float, amplitude: float, omega: float, t: Vector) -> Vector:
    return np.asarray(mean + amplitude * np.sin(omega * t))


def _force_steps(
    size: Sizes, table: str, forces: tuple[float, ...], fine: bool = False
) -> list[Trial]:
    return [
        Trial(
            f"{table}/{k}",
            table,
            k,
            FORCE,
            f"step of the force to {size.says_force(force)}",
            FORCE_STEP_TIME,
            partial(_constant, force),
            fine and size.plates,
            "duration not printed: 10 s",
            force,
        )
        for k, force in enumerate((size.force * f for f in forces), start=1)
    ]


def _velocity_sines(size: Sizes, table: str, rows: list[tuple[float, float, float]]) -> list[Trial]:
    sized = [(size.speed * a, omega, end) for a, omega, end in rows]
    shares = [size.shorter(2 * a / omega) for a, omega, _ in sized]
    rows = [(a, w / s, s * end) for (a, w, end), s in zip(sized, shares, strict=True)]
    return [
        Trial(
            f"{table}/{k}",
            table,
            k,
            VELOCITY,
            f"velocity {size.says(amplitude)} sin({omega:.4g} t)",
            duration,
            partial(_sine, 0.0, amplitude, omega),
            level=amplitude,
        )
        for k, (amplitude, omega, duration) in enumerate(rows, start=1)
    ]


def _constant_velocities(
    size: Sizes, table: str, velocities: list[float], note: str
) -> list[Trial]:
    return [
        Trial(
            f"{table}/{k}",
            table,
            k,
            VELOCITY,
            f"constant velocity {size.says(velocity)}",
            CONSTANT_VELOCITY_TIME * size.shorter(CONSTANT_VELOCITY_TIME * velocity),
            partial(_constant, velocity),
            note=note,
            level=velocity,
        )
        for k, velocity in enumerate((size.speed * v for v in velocities), start=1)
    ]


LOADING_RATES = tuple(float(f"{0.08 * (20.3 / 0.08) ** (k / 19):.3g}") for k in range(20))
"""Twenty loading rates from 0.08 to 20.3 N/s, logarithmically spaced [N/s]."""


def _loading_rates(size: Sizes) -> list[Trial]:
    from .regulators import loading_voltage

    loading = size.loading or loading_voltage
    note = (
        "the thesis applies constant voltages; on a rigid drive this gives no constant loading "
        "rate, so the voltage is a ramp computed for the nominal stuck block; when the bristles "
        "yield, the force rises more slowly; rates between the first and the last are not printed"
    )
    trials, what = [], "command" if size.loading else "voltage"
    for k, rate in enumerate(LOADING_RATES, start=1):
        duration = math.ceil((RAMP_TO / rate + 0.5) / SAMPLE_TIME) * SAMPLE_TIME
        trials.append(
            Trial(
                f"loading-rate/{k}",
                "loading-rate",
                k,
                VOLTAGE,
                f"{what} ramp that loads the block at {size.says_force(size.force * rate, '/s')}",
                duration,
                partial(loading, size.force * rate),
                note="" if size.loading else note,
                level=size.force * rate,
            )
        )
    return trials


def _staircase(force: float, t: Vector) -> Vector:
    """Fig. 2.13: 2 s of zero force, then three times 2 s of 0.25 N/s and a hold of 3 s."""
    corners = [(0.0, 0.0), (2.0, 0.0)]
    for step in range(3):
        start = 2.0 + 5.0 * step
        corners += [(start + 2.0, 0.5 * (step + 1)), (start + 5.0, 0.5 * (step + 1))]
    times, forces = zip(*corners, strict=True)
    return np.asarray(force * np.interp(t, times, forces))


def trials_of(size: Sizes) -> dict[str, Trial]:
    """All trials by name, scaled to a machine."""
    steps = (0.3, 0.6, 1.0, 1.5, 1.8, 2.0, 2.1, 2.2, -0.3, -0.6, -2.1, -2.3, -2.4)
    slow = [round(1e-3 * (2.0 + 0.5 * k), 6) for k in range(8)]
    fast = [round(1e-3 * k, 6) for k in range(3, 9)]
    dahl = [(1.0, 3.15), (1 / 2, 6.3), (1 / 4, 12.6), (1 / 6, 19.0)]
    bliman = [
        (2e-3, 2 / 3, 18.85),
        (2e-3, 4 / 5, 15.7),
        (2e-3, 1.0, 12.57),
        (3e-3, 2 / 3, 18.85),
        (4e-3, 2 / 3, 18.85),
        (5e-3, 2 / 3, 18.85),
        (6e-3, 2 / 3, 18.85),
        (6e-3, 4 / 5, 15.7),
        (6e-3, 1.0, 12.57),
    ]
    lag = size.shorter(18.85 * 1.5e-3 * size.speed)
    mean, swing, omega = 1.5e-3 * size.speed, 1e-3 * size.speed, 3.0 / lag
    trials = [
        *_force_steps(size, "2.2", steps),
        *_constant_velocities(
            size,
            "2.3.1",
            [*slow, *(-v for v in slow)],
            "the text says fifteen trials, its list has sixteen; duration not printed: 4 s",
        ),
        *_velocity_sines(
            size,
            "2.4",
            [(s * 1e-3, w, end) for s in (1, -1) for w, end in dahl for _ in range(2)],
        ),
        *_velocity_sines(size, "2.6", bliman),
        *_force_steps(size, "2.8", (0.5, 0.5, 1.0, 1.0, 1.5, 1.5), fine=True),
        *_force_steps(size, "2.10", steps),
        Trial(
            "2.11/1",
            "2.11",
            1,
            VELOCITY,
            f"velocity {size.says(mean)} + {size.says(swing)} sin({omega:.4g} t)",
            18.85 * lag,
            partial(_sine, mean, swing, omega),
            level=swing,
        ),
        *_constant_velocities(
            size,
            "viscous",
            [v for speed in fast for v in [speed] * 5 + [-speed] * 5],
            "Section 2.4.1, five repetitions each; duration not printed: 4 s",
        ),
        *_loading_rates(size),
        Trial(
            "presliding/1",
            "presliding",
            1,
            FORCE,
            f"staircase of the force to {', '.join(f'{f * size.force:.4g}' for f in (0.5, 1.0))} "
            f"and {size.says_force(1.5 * size.force)} (Fig. 2.13)",
            17.0,
            partial(_staircase, size.force),
            size.plates,
            level=1.5 * size.force,
        ),
    ]
    return {t.name: t for t in trials}


TRIALS: dict[str, Trial] = trials_of(Sizes())
TABLES: tuple[str, ...] = tuple(dict.fromkeys(t.table for t in TRIALS.values()))
PRESLIDING: tuple[str, ...] = ("2.8", "presliding")
"""Tables and series about displacements before break-away."""
SECTION_2_4: tuple[str, ...] = ("2.10", "viscous", "2.11", "loading-rate", "presliding")
"""The tables and series of the five feature experiments."""


def trials_named(name: str, trials: Mapping[str, Trial] = TRIALS) -> list[Trial]:
    """The trial of this name, or all trials of a table.

    ``2.4/7``, ``table-2.4-7`` and ``2.4-7`` are the same; ``2.4`` means all trials of Table 2.4; a
    series of one trial, such as ``presliding``, needs no number.

    Raises
    ------
    BadParameter
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
    known = TRIALS if "/" in plain else TABLES
    hint = did_you_mean(plain, known)
    raise BadParameter(
        f"no trial {name!r}; there are {', '.join(TABLES)}, or one trial as in 2.4/7{hint}"
    )
