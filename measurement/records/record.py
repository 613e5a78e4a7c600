"""A record of instruments or a drive: signals at equidistant instants in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...solver.arrays import Vector
from .resolution import encoder_count

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
