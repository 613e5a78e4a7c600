"""A position PID with velocity feedback, tuned by the SIMC rule.

S. Skogestad, "Simple analytic rules for model reduction and PID controller tuning", Journal of
Process Control 13, 291 (2003), for an integrating process with a lag: the rigid axis; the
electrical time constant counts as delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..plant.axis import axis
from ..solver.component import Component, Output, Parameter, State, symbol
from .linearization import measurements_of
from .rigid_axis import rigid_axis

CLOSED_LOOP_TIME = 0.6
"""Tuning parameter of the rule [s]: an 8 cm step stays within the 36 V of the motor."""

TUNABLE = {"Kp": (50.0, 5e4), "Ki": (0.0, 5e4), "Kd": (0.0, 500.0)}


@dataclass(frozen=True)
class PidGains:
    """Gains of the parallel form: Kp [V/m], Ki [V/(m*s)], Kd [V*s/m]."""

    proportional: float
    integral: float
    derivative: float


def simc(
    plant_parameters: Mapping[str, float] | None = None, closed_loop_time: float = CLOSED_LOOP_TIME
) -> PidGains:
    """The SIMC gains for a plant.

    Parameters
    ----------
    plant_parameters : mapping of str to float, optional
        Parameters of the plant with other than nominal values.
    closed_loop_time : float
        The rule's one tuning parameter [s].
    """
    plant = rigid_axis(plant_parameters)
    delay = plant.electrical_time
    gain = 1 / (plant.speed_per_volt * (closed_loop_time + delay))
    integral_time = 4 * (closed_loop_time + delay)
    return PidGains(gain * (1 + plant.lag / integral_time), gain / integral_time, gain * plant.lag)


def gain_parameters() -> tuple[Parameter, ...]:
    """Kp, Ki and Kd with the nominal plant's SIMC gains as defaults."""
    gains = simc()
    source = f"SIMC rule with a closed-loop time of {CLOSED_LOOP_TIME} s"
    return (
        Parameter("Kp", gains.proportional, "V/m", "proportional gain", source),
        Parameter("Ki", gains.integral, "V/(m*s)", "integral gain", source),
        Parameter("Kd", gains.derivative, "V*s/m", "gain on the measured velocity", source),
    )


def pid() -> Component:
    """The continuous controller: `u` [V] from x, v and x_d."""
    error = symbol("x_d") - symbol("x")
    command = symbol("Kp") * error + symbol("Ki") * symbol("w") - symbol("Kd") * symbol("v")
    return Component(
        name="pid",
        description="Position PID with velocity feedback",
        parameters=gain_parameters(),
        inputs=measurements_of(axis()),
        states=(State("w", "m*s", "integral of the position error", error, nominal=1e-3),),
        outputs=(Output("u", "V", "motor terminal voltage", command, nominal=10.0),),
    )
