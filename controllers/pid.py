"""Position PIDs, continuous and digital, tuned by the SIMC rule.

S. Skogestad, "Simple analytic rules for model reduction and PID controller tuning", Journal of
Process Control 13, 291 (2003), for an integrating process with a lag: the rigid axis; the
electrical time constant counts as delay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from ..plant.axis import axis
from ..plant.instruments.sample_and_hold import PERIOD
from ..solver.component import Component, DiscreteState, Parameter, State, symbol
from .limited import U_MAX, measurements_of, plain_output, tracked_integral, tracking_time
from .rigid_axis import rigid_axis

CLOSED_LOOP_TIME = 0.6
"""Tuning parameter of the rule [s]: an 8 cm step stays within the 36 V of the motor."""

ERROR = symbol("x_d") - symbol("x")
PID_VOLTAGE = symbol("Kp") * ERROR + symbol("w") - symbol("Kd") * symbol("v")
"""Proportional, integral and derivative part of a law within a voltage limit [V]."""

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
    """The SIMC gains for a plant with these values; the rule has one tuning parameter [s]."""
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
    command = symbol("Kp") * ERROR + symbol("Ki") * symbol("w") - symbol("Kd") * symbol("v")
    return Component(
        name="pid",
        description="Position PID with velocity feedback",
        parameters=gain_parameters(),
        inputs=measurements_of(axis()),
        states=(State("w", "m*s", "integral of the position error", ERROR, nominal=1e-3),),
        outputs=(plain_output(command),),
    )


def pid_sampled() -> Component:
    """Backward-difference velocity and rectangular integration at ``sample_time``."""
    period = symbol("sample_time")
    integral = symbol("w") + period * ERROR
    speed = (symbol("x") - symbol("x_last")) / period
    command = symbol("Kp") * ERROR + symbol("Ki") * integral - symbol("Kd") * speed
    return Component(
        name="pid_sampled",
        description="Digital position PID; its output is held between samples",
        parameters=gain_parameters(),
        inputs=measurements_of(axis()),
        discrete=(
            DiscreteState("w", "m*s", "sum of the position error", integral),
            DiscreteState("x_last", "m", "position at the last sample", symbol("x")),
            DiscreteState("u_held", "V", "command since the last sample", command),
        ),
        outputs=(plain_output(symbol("u_held")),),
        sample_time=PERIOD,
    )


def pid_parameters() -> tuple[Parameter, ...]:
    """The gains of `pid`, the tracking time and the limit, for laws that compensate friction."""
    gains = simc()
    times = gains.proportional / gains.integral, gains.derivative / gains.proportional
    return (
        *gain_parameters(),
        tracking_time(math.sqrt(times[0] * times[1]), "sqrt(Ti Td), Astrom and Hagglund (2006)"),
        U_MAX,
    )


def pid_integral(command: sp.Expr) -> State:
    """The integral part of a law with this command."""
    return tracked_integral(symbol("Ki") * ERROR, command)
