"""The digital position PID: sampled, with position only, output held."""

from __future__ import annotations

from ..instruments.sample_and_hold import PERIOD
from ..plant.axis import axis
from ..solver.component import Component, DiscreteState, Output, symbol
from .linearization import measurements_of
from .pid import gain_parameters


def pid_sampled() -> Component:
    """Backward-difference velocity and rectangular integration at ``sample_time``."""
    error = symbol("x_d") - symbol("x")
    period = symbol("sample_time")
    integral = symbol("w") + period * error
    speed = (symbol("x") - symbol("x_last")) / period
    command = symbol("Kp") * error + symbol("Ki") * integral - symbol("Kd") * speed
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
        outputs=(Output("u", "V", "motor terminal voltage", symbol("u_held"), nominal=10.0),),
        sample_time=PERIOD,
    )
