"""Range of a machine, from its records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .drive import Drive
from .modelled_record import ModelledRecord

MARGIN = 0.05  # of the travel, left at each end
USED = 0.9  # of the largest speed and command
_HEADROOM = 0.5  # share of the force beyond friction that is used to accelerate


@dataclass(frozen=True)
class Reach:
    """Range of a machine, from its records.

    Attributes
    ----------
    low, high : float
        Ends of the travel [m].
    speed, acceleration : float
        Largest speed [m/s]; acceleration that it exceeds in a twentieth of the time [m/s^2].
    command : float
        Largest magnitude of the command, in its unit.
    step : float
        Sampling interval [s].
    resolution : float
        Step of the encoder [m]; 0 if positions are not quantized.
    lasts : float
        Length of the longest record [s].
    """

    low: float
    high: float
    speed: float
    acceleration: float
    command: float
    step: float
    resolution: float
    lasts: float

    @property
    def travel(self) -> float:
        return self.high - self.low


def reach_of(courses: Sequence[ModelledRecord]) -> Reach:
    """Range shown by all records of a study together."""
    return Reach(
        low=min(float(c.x.min()) for c in courses),
        high=max(float(c.x.max()) for c in courses),
        speed=max(float(np.abs(c.v).max()) for c in courses),
        acceleration=max(float(np.quantile(np.abs(c.mean_a), 0.95)) for c in courses),
        command=max(float(np.abs(c.u).max()) for c in courses),
        step=min(c.step for c in courses),
        resolution=max(c.record.resolution for c in courses),
        lasts=max(float(c.time[-1]) for c in courses),
    )


# -- capability of the machine -----------------------------------------------------------------


def largest_friction(model: Drive) -> float:
    """Largest friction of slow motion, break-away included [N]."""
    static = [abs(model.values[n]) for n in ("Fs", "Fs_pos", "Fs_neg") if n in model.values]
    return max([model.friction_scale, *static])


def force_to_spare(reach: Reach, model: Drive) -> float:
    """Force of the largest used command, less friction [N]."""
    offset = abs(model.values["offset"]) if not model.has_motor else 0.0
    return USED * abs(model.per_command) * reach.command - largest_friction(model) - offset


def fastest_speed(reach: Reach, model: Drive) -> float:
    """Recorded speed at which the model still has a force reserve [m/s]."""
    known = USED * reach.speed
    damping = model.damping
    spare = 0.8 * force_to_spare(reach, model)
    return min(known, spare / damping) if spare > 0.0 and damping > 0.0 else known


def acceleration_to(reach: Reach, model: Drive, speed: float) -> float:
    """Acceleration up to a speed [m/s^2]: that of the records, if the force is sufficient."""
    spare = _HEADROOM * (force_to_spare(reach, model) - model.damping * speed) / model.inertia
    return min(reach.acceleration, spare) if spare > 0.0 else 0.5 * reach.acceleration


def columns(model: Drive) -> tuple[str, ...]:
    return ("time", "u", "x", *(("i",) if model.has_motor else ()))
