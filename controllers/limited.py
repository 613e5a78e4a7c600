"""What controllers of the axis share: measurements, the voltage limit, and anti-windup.

An integral ``w`` [V] has anti-windup by back-calculation: the part of the command beyond the limit,
divided by the tracking time `Tt`, is added to its rate. Source: K. J. Astrom and T. Hagglund,
"Advanced PID Control", ISA (2006), section 3.5.
"""

from __future__ import annotations

import sympy as sp

from ..plant.axis import axis
from ..plant.instruments import NOMINAL_VOLTAGE
from ..plant.instruments.amplifier import clip
from ..solver.component import Component, Input, Output, Parameter, State, symbol

_SOURCE = "Table 2.1: the nominal amplifier"
U_MAX = Parameter(
    "u_max", NOMINAL_VOLTAGE, "V", "largest magnitude of the command", _SOURCE, 1e-3, 1e6
)


def measurements_of(plant: Component) -> tuple[Input, ...]:
    """Controller inputs for all signals on which a law may act, and the set-point `x_d`.

    Every controller has them all, used or not, so that controllers can be exchanged without new
    connections.
    """
    (command,) = plant.inputs
    outputs = [plant.output(name) for name in command.law]
    return (
        *(
            Input(o.name, o.unit, "measured " + o.meaning, nominal=o.nominal, role="measurement")
            for o in outputs
        ),
        Input("x_d", "m", "desired position", nominal=0.1, role="reference"),
    )


def voltage_law(
    name: str,
    description: str,
    parameters: tuple[Parameter, ...],
    command: sp.Expr,
    states: tuple[State, ...] = (),
    derivatives: tuple[Input, ...] = (),
) -> Component:
    """A controller of the axis: the output `u` [V] is its command, limited by `u_max`."""
    inputs = (*measurements_of(axis()), *derivatives)
    return Component(name, description, parameters, inputs, states, (voltage_output(command),))


def limit(command: sp.Expr) -> sp.Expr:
    """The command within both signs of `u_max`."""
    return clip(command, -symbol("u_max"), symbol("u_max"))


def ramp(value: sp.Expr, low: sp.Expr, high: sp.Expr) -> sp.Expr:
    """0 below `low`, 1 above `high` and a line in between.

    Written with `Abs`, whose derivative is short: a law multiplies several of these and limits
    them.
    """
    return sp.Rational(1, 2) + (sp.Abs(value - low) - sp.Abs(value - high)) / (2 * (high - low))


def plain_output(command: sp.Expr) -> Output:
    """The command as the output `u`."""
    return Output("u", "V", "motor terminal voltage", command, nominal=10.0)


def voltage_output(command: sp.Expr) -> Output:
    """The limited command as the output `u`."""
    return plain_output(limit(command))


def tracking_time(default: float, source: str) -> Parameter:
    """The parameter `Tt`."""
    return Parameter("Tt", default, "s", "tracking time of the anti-windup", source, minimum=1e-6)


def tracked_integral(rate: sp.Expr, command: sp.Expr) -> State:
    """The integral `w` [V] with this rate [V/s], which is part of the command."""
    excess = limit(command) - command
    return State("w", "V", "integral part", rate + excess / symbol("Tt"), nominal=0.1)
