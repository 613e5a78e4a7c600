"""A record of instruments or a drive: signals at equidistant instants in SI units.

Resolution, noise and held values of an instrument are found from its column.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector

VELOCITY = "v"
VOLTAGE, CURRENT, FORCE, TORQUE = "voltage", "current", "force", "torque"
_FINE_RANGE = 1e-4  # range of a fine position next to a coarse one; calibrated over 70 um [m]


@dataclass(frozen=True)
class Record:
    """The record of one run: columns by name, in SI units.

    ``time``, a position and the columns for its use are always present, and ``v`` if `x` is its
    integral. A column with a lower rate is NaN in between.
    """

    name: str
    signals: Mapping[str, Vector]
    step: float  # sampling interval [s]
    command: str = VOLTAGE  # kind of `u`, in V, A, N or N*m; "current" if a drive has no `u`
    mass: float = 1.0  # between load cell and friction [kg]
    lags: Mapping[str, float] = field(default_factory=dict)  # of columns, by their instrument [s]
    delay_std: float = 0.0  # of the unknown delay between force and motion [s]
    gain_std: float = 0.0  # of the scale of `position` after its calibration [1]
    about: Mapping[str, Any] = field(default_factory=dict)  # the rig's ``trial.json``
    notes: tuple[str, ...] = ()  # changes made to the record, and unknown properties
    lead: float | None = None  # of the screw by which a recorded torque became a force [m]

    @property
    def time(self) -> Vector:
        return self.signals["time"]

    @property
    def u(self) -> Vector:
        """The command; missing if `current_alone`."""
        return self.signals["u"]

    @property
    def current_alone(self) -> bool:
        """Whether the current `i` is the only command: there is no `u`."""
        return "i" in self.signals and "u" not in self.signals

    @property
    def force(self) -> Vector:
        return self.signals["force"]

    @property
    def x(self) -> Vector:
        return self.signals["x"]

    @property
    def velocity_alone(self) -> bool:
        """Whether the velocity was recorded, but no position."""
        return VELOCITY in self.signals

    @property
    def position_name(self) -> str:
        """Name of the fine position column if present and within its range, else of the other."""
        if "x_fine" not in self.signals:
            return "x"
        within = "x" not in self.signals or float(np.ptp(self.signals["x"])) < _FINE_RANGE
        return "x_fine" if within else "x"

    @property
    def position(self) -> Vector:
        return self.signals[self.position_name]

    @cached_property
    def resolution(self) -> float:
        """Step of a quantized `x` [m]; 0 if it is not quantized."""
        return 0.0 if self.velocity_alone else encoder_count(self.x)


def resolution_of(values: Vector) -> float:
    """Step of the grid on which all values lie; 0 without a grid."""
    levels = np.unique(values)
    if len(levels) < 2:
        return 0.0
    tiny = 1e-9 * float(np.abs(levels).max())  # rounding by the text
    gaps = np.diff(levels)
    gaps = np.unique(gaps[gaps > tiny])
    step = float(gaps[0])
    for _ in range(40):  # Euclid's algorithm on all gaps at once, to within a fiftieth of the step
        rest = np.abs(gaps - step * np.round(gaps / step))
        rest = rest[rest > 0.02 * step]
        if not len(rest):
            break
        step = float(rest.min())
        if step < 4 * tiny:
            return 0.0
    counts = np.round(gaps / step)
    return float(np.sum(gaps) / np.sum(counts))


def encoder_count(position: Vector) -> float:
    """Step of a quantized position; 0 if its noise hides the grid.

    Rounding alone gives a noise of 0.29 counts. If the instrument adds the same or more, as an
    interpolated encoder or a filter does, the edges of the counts no longer give the position.
    """
    resolution = resolution_of(position)
    rounding = resolution / math.sqrt(12)
    return resolution if fast_noise(position) < math.sqrt(2) * rounding else 0.0


def fast_noise(values: Vector, where: npt.NDArray[np.bool_] | None = None) -> float:
    """Standard deviation of the part of a signal that differs from sample to sample.

    It is computed from third differences, which are nearly zero for a smooth course. Their root
    mean square is over the nine tenths of the record with the smallest values, so that a jump does
    not count as noise. `where`, shape (n - 3,), selects some of them.
    """
    third = np.abs(np.diff(values, 3))
    third = third if where is None else third[where]
    if not len(third) or not np.any(third):
        return 0.0
    ordered = np.sort(third)
    kept = ordered[: max(1, int(0.9 * len(ordered)))]
    # a normal variable cut at its 90 % quantile has 0.615 of its variance
    return float(np.sqrt(np.mean(kept**2) / 0.615 / 20.0))


def held_samples(values: Vector) -> npt.NDArray[np.int64]:
    """Indices of the samples with a new value, if a converter holds each for several samples.

    All indices if values are not held in runs of one length.
    """
    fresh = np.concatenate([[0], 1 + np.flatnonzero(np.diff(values))])
    everything = np.arange(len(values))
    if len(fresh) < 10 or len(np.unique(values)) < 0.7 * len(fresh):
        return everything  # quantized values repeat
    runs = np.diff(fresh)[1:]
    usual = int(np.median(runs))
    regular = np.mean(runs % usual == 0) > 0.9
    return fresh if usual > 1 and regular else everything
