"""The proposed motion: one for all machines, scaled to the present machine.

The machine moves once over the travel, forwards and backwards, with an oscillation added, so that
it reverses at all positions and at many speeds and accelerations. The motion has no rests, because
rests give no information on forces. Each part of it contains all speeds, because parts are held out
one at a time.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.arrays import Vector
from ...solver.files import write_atomically
from .drive import Drive
from .machine_reach import MARGIN, Reach, acceleration_to, columns, fastest_speed

COMMAND_FILE = "next_experiment.csv"
POSITION = "x_d"
_ROWS = 1e-3  # shortest time between rows of a command file [s]
_REST = 0.1  # rest before the motion [s]
_SHORTEST = 12.0  # [s]
_LOBES = 6  # parts of the oscillation, alternately at its higher and its lower frequency
_SLOWER = 3.0
_OVER, _BESIDE = 0.35, 0.15  # slow motion and oscillation: amplitudes over the travel
_GOING = 0.4  # largest speed of the slow motion, as a share of the fastest speed
_HARDNESS = 0.8  # used share of the available acceleration
_SAMPLES_A_PERIOD = 40


@dataclass(frozen=True)
class Motion:
    """The motion to command, and the signals to record.

    Attributes
    ----------
    kind : str
    says : str
        Description with numbers, as a clause.
    reference : {"x_d"}
        Kind of `values`: the reference position of the controller [m].
    time, values : ndarray, shape (n,)
        Rows of the command file, from rest to rest.
    amplitude : float
        Half of the difference between the largest and the smallest value.
    speeds : tuple of float
        Largest speeds of the motion over the travel and of the oscillation, in both directions
        [m/s].
    record : tuple of str
        Columns, with our names.
    sampling : float
        Largest sampling interval of the record [s].
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
        """Duration [s]."""
        return float(self.time[-1])

    def to_dict(self) -> dict[str, Any]:
        """Its content in `diagnosis.json`."""
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
        """Write ``next_experiment.csv``: ``time`` [s] and ``x_d`` [m].

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


def survey(reach: Reach, model: Drive, lasts: float) -> Motion:
    """Return the motion over the travel, with an oscillation at all positions.

    Parameters
    ----------
    reach : Reach
    model : Drive
        Gives friction and the force of the command, as far as known.
    lasts : float
        Duration [s]; a minimum applies. A longer record has coarser windows, so use the length of
        the present records to resolve effects of milliseconds equally well.
    """
    rows = max(reach.step, _ROWS)
    way = (1.0 - 2.0 * MARGIN) * reach.travel
    fastest = fastest_speed(reach, model)
    hardest = _HARDNESS * acceleration_to(reach, model, fastest)
    lasts = max(lasts, _SHORTEST)
    over = min(_OVER * way, _GOING * fastest * lasts / (2 * math.pi))
    going = 2 * math.pi / lasts * over
    swing = min((fastest - going) ** 2 / hardest, _BESIDE * way)
    rate = min(math.sqrt(hardest / swing), 2 * math.pi / (_SAMPLES_A_PERIOD * rows))
    swing = min((fastest - going) / rate, _BESIDE * way)
    time: Vector = np.asarray(rows * np.arange(round(lasts / rows) + 1), dtype=float)
    share = time / time[-1]
    lobe = np.minimum(np.floor(_LOBES * share), _LOBES - 1)
    rates = np.where(lobe % 2 == 0, rate, rate / _SLOWER)
    swings = np.sin(rates * (time - lobe * time[-1] / _LOBES))
    x = swing * np.sin(_LOBES * math.pi * share) ** 2 * swings - over * np.cos(2 * math.pi * share)
    x += 0.5 * (reach.low + reach.high)
    values = np.concatenate([np.full(max(round(_REST / rows), 1), x[0]), x])
    time = np.asarray(rows * np.arange(len(values)), dtype=float)
    record = columns(model)
    says = (
        f"forwards and backwards over {_mm(2.0 * over)} and in addition forwards and backwards by "
        "up to "
        f"{_mm(2.0 * swing)}, at {_hz(rate)} and {_hz(rate / _SLOWER)} alternately; from x = "
        f"{_mm(float(values[0]))}, between {_mm(float(values.min()))} and "
        f"{_mm(float(values.max()))}, {time[-1]:.3g} s; record {', '.join(record)} every "
        f"{1e3 * reach.step:.3g} ms or faster"
    )
    amplitude = 0.5 * float(np.ptp(values))
    speeds = going, swing * rate
    return Motion(
        "travel with reversals", says, POSITION, time, values, amplitude, speeds, record, reach.step
    )


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"


def _hz(rate: float) -> str:
    return f"{rate / (2 * math.pi):.3g} Hz"
