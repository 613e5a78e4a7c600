"""Model of the axis for the tuning rules: the rigid drive without Coulomb friction.

Its speed follows the voltage with the gain ``b`` and the lag ``(m + Jm (2 pi p)^2)/D``, where
``D = sigma2 + kt ke (2 pi p)^2 / R``; the electrical time constant ``L/R`` is neglected, or counts
as delay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..plant.axis import axis
from ..solver.component import Parameter


@dataclass(frozen=True)
class RigidAxis:
    """The rigid axis in numbers."""

    force_per_volt: float  # force of the motor at rest [N/V]
    damping: float  # damping by viscous friction and back-EMF [N*s/m]
    inertia: float  # inertia of block and rotor [kg]
    electrical_time: float  # L/R [s]

    @property
    def speed_per_volt(self) -> float:
        """Steady speed under one volt [m/(s*V)]."""
        return self.force_per_volt / self.damping

    @property
    def lag(self) -> float:
        """Time constant of the speed [s]."""
        return self.inertia / self.damping


def nominal(name: str) -> float:
    """Value of a parameter of the nominal axis."""
    return next(p.default for p in axis().all_parameters if p.name == name)


def rigid_axis(plant_parameters: Mapping[str, float] | None = None) -> RigidAxis:
    """The rigid axis of the nominal plant, or of a plant with other parameters."""
    values = {p.name: p.default for p in axis().all_parameters} | dict(plant_parameters or {})
    angle = 2 * math.pi * values["p"]
    torque = values["kt"] * angle
    return RigidAxis(
        force_per_volt=torque / values["R"],
        damping=values["sigma2"] + torque * values["ke"] * angle / values["R"],
        inertia=values["m"] + values["Jm"] * angle**2,
        electrical_time=values["L"] / values["R"],
    )


def model_parameters() -> tuple[Parameter, Parameter]:
    """``b`` and ``lag`` of the nominal axis, as parameters of a law that uses them."""
    rigid, steady = rigid_axis(), "steady speed of the axis under one volt"
    source = "the plant's equations, rigid and without Coulomb friction"
    return (
        Parameter("b", rigid.speed_per_volt, "m/(s*V)", steady, source, minimum=1e-9),
        Parameter("lag", rigid.lag, "s", "time constant of its speed", source, minimum=1e-9),
    )
