"""The next experiment: a motion that shows more than the records, and what would confirm a cause.

It is one for all machines, scaled to what the records show of this one. The machine moves once over
the travel, forwards and backwards, with an oscillation added, so that it reverses at all positions
and at many speeds and accelerations. The motion has no rests, because rests give no information on
forces. Each part of it contains all speeds, because parts are held out one at a time.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...solver.arrays import Vector
from ...solver.files import write_atomically
from .bands import BLOCKS
from .causes import EVERY, OUTSIDE
from .model import Drive
from .motion import Course
from .rule import Explained

COMMAND_FILE = "next_experiment.csv"
_USED = 0.9  # of the travel and of the largest speed, acceleration, command and viscous friction
_SHORTEST = 12.0  # [s]
_LOBES = BLOCKS + 1  # of the oscillation, quick and slow ones; each part held out has both
_SLOWER = 3.0  # also the length over that of the records, if a suspect is slow
_OVER = 0.35  # amplitude of the slow motion over the travel; the oscillation has the rest
_SAMPLES_A_PERIOD = 40
MOST_NAMED = 3  # suspects in a text
_SLOW = ("friction_drift", "resistance_drift")


class Reach(NamedTuple):
    """Range of a machine, as its records show it."""

    low: float  # ends of the travel [m]
    high: float
    speed: float  # largest [m/s]
    acceleration: float  # exceeded in a twentieth of the time [m/s^2]
    command: float  # largest magnitude, in its unit
    step: float  # sampling interval [s]
    lasts: float  # longest record [s]


def reach_of(courses: Sequence[Course]) -> Reach:
    """Range shown by all records of a study together."""
    return Reach(
        low=min(float(c.x.min()) for c in courses),
        high=max(float(c.x.max()) for c in courses),
        speed=max(float(np.abs(c.v).max()) for c in courses),
        acceleration=max(float(np.quantile(np.abs(c.mean_a), 0.95)) for c in courses),
        command=max(float(np.abs(c.u).max()) for c in courses),
        step=min(c.step for c in courses),
        lasts=max(float(c.time[-1]) for c in courses),
    )


def fastest_and_hardest(reach: Reach, model: Drive) -> tuple[float, float]:
    """Used speed [m/s] and acceleration [m/s^2], for which the command has force by a model.

    The acceleration has half of the force that dry and viscous friction leave.
    """
    static = [abs(model.values[n]) for n in ("Fs", "Fs_pos", "Fs_neg") if n in model.values]
    spare = _USED * abs(model.linear.per_command) * reach.command
    spare -= max([model.friction_scale, *static])  # of slow motion, break-away included
    spare -= 0.0 if model.has_motor else abs(model.values["offset"])
    fastest = _USED * reach.speed
    if spare > 0.0 and model.damping > 0.0:
        fastest = min(fastest, _USED * spare / model.damping)
    possible = 0.5 * (spare - model.damping * fastest) / model.linear.inertia
    hardest = min(reach.acceleration, possible) if possible > 0.0 else reach.acceleration
    return fastest, _USED * hardest


@dataclass(frozen=True)
class NextExperiment:
    """The purpose of the next experiment, and the motion to command, from rest to rest."""

    says: str
    motion: dict[str, Any]  # as in `diagnosis.json`
    time: Vector  # rows of the command file [s]
    values: Vector  # reference position of the controller [m]

    def to_dict(self) -> dict[str, Any]:
        """Its content in `diagnosis.json`."""
        return {"says": self.says, "motion": self.motion}

    def save(self, folder: Path) -> None:
        """Write ``next_experiment.csv``: ``time`` [s] and ``x_d`` [m]; an OSError says why not."""
        stream, table = io.StringIO(), np.column_stack([self.time, self.values])
        np.savetxt(stream, table, fmt="%.9g", delimiter=",", header="time,x_d", comments="")
        write_atomically(folder / COMMAND_FILE, stream.getvalue().encode())


def survey(says: str, reach: Reach, model: Drive, lasts: float) -> NextExperiment:
    """Return the motion over the travel, with an oscillation at all positions.

    It lasts `lasts` [s]; a minimum applies. A longer record has coarser windows, so the length of
    the present records resolves effects of milliseconds equally well. The model gives friction and
    the force of the command. The slow motion has at most half of the speed.
    """
    rows, way = reach.step, _USED * (reach.high - reach.low)
    fastest, hardest = fastest_and_hardest(reach, model)
    lasts = max(lasts, _SHORTEST)
    over = min(_OVER * way, 0.5 * fastest * lasts / (2 * math.pi))
    going = 2 * math.pi / lasts * over
    beside = (0.5 - _OVER) * way
    swing = min((fastest - going) ** 2 / hardest, beside)
    rate = min(math.sqrt(hardest / swing), 2 * math.pi / (_SAMPLES_A_PERIOD * rows))
    swing = min((fastest - going) / rate, beside)
    time: Vector = np.asarray(rows * np.arange(round(lasts / rows) + 1), dtype=float)
    share = time / time[-1]
    lobe = np.minimum(np.floor(_LOBES * share), _LOBES - 1)
    rates = np.where(lobe % 2 == 0, rate, rate / _SLOWER)
    swings = np.sin(rates * (time - lobe * time[-1] / _LOBES))
    x = swing * np.sin(_LOBES * math.pi * share) ** 2 * swings - over * np.cos(2 * math.pi * share)
    values = x + 0.5 * (reach.low + reach.high)
    record = ["time", "u", "x", *(["i"] if model.has_motor else [])]
    start, low, high = (f"{1e3 * float(p):.3g} mm" for p in (values[0], values.min(), values.max()))
    quick, slow = (f"{r / (2 * math.pi):.3g} Hz" for r in (rate, rate / _SLOWER))
    course = (
        f"forwards and backwards over {2e3 * over:.3g} mm and in addition forwards and backwards "
        f"by up to {2e3 * swing:.3g} mm, at {quick} and {slow} alternately; from x = {start}, "
        f"between {low} and {high}, {time[-1]:.3g} s; record {', '.join(record)} every "
        f"{1e3 * reach.step:.3g} ms or faster"
    )
    motion = {
        "kind": "travel with reversals",
        "says": course,
        "reference": "x_d",
        "amplitude": 0.5 * float(np.ptp(values)),
        "speeds_m_per_s": [going, swing * rate],
        "start": float(values[0]),
        "duration_s": float(time[-1]),
        "record": record,
        "sampling_s": reach.step,
        "file": COMMAND_FILE,
    }
    return NextExperiment(says, motion, time, values)


def next_experiment(found: Explained, quiet: bool) -> NextExperiment:
    """The motion and its purpose, about what is undecided; `quiet` if no fault was seen."""
    undecided = [*(m for m in found.built if m.name in found.alternatives), *found.suspects]
    undecided = undecided or [m for m in found.built if not m.certain]
    known = [m for m in undecided if m.name != OUTSIDE]
    names = [m.name for m in sorted(known, key=lambda m: -m.score)][:MOST_NAMED]
    reach = reach_of(found.study.courses)
    longer = _SLOWER if any(n in _SLOW for n in names) else 1.0
    if quiet:
        says = "these records show no fault; this motion may show faults that need more motion"
    elif not names:
        says = "part of the residual has no known cause"
    elif len(names) == 1 or not found.suspects:
        says = f"what would confirm {names[0]}: {EVERY[names[0]].confirm}"
    else:
        says = (
            f"these records cannot distinguish {names[0]} from {' or '.join(names[1:])}; "
            f"what would confirm {names[0]}: {EVERY[names[0]].confirm}"
        )
    return survey(says, reach, found.study.model, longer * reach.lasts)
