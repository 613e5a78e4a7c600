"""Cascade of a position P and a velocity PI with feed-forward: the usual controller in drives.

The velocity loop is tuned by the SIMC rule for a lag with a delay (S. Skogestad, Journal of Process
Control 13, 291 (2003)): it becomes a lag of the time `VELOCITY_TIME`. The position gain gives
critical damping of this lag with an integrator, ``1/(4 VELOCITY_TIME)``. The feed-forward inverts
the axis without Coulomb friction: at the velocity ``v_d`` and the acceleration ``a_d`` it needs
``v_d/b + (m R + sigma2 L)/(2 pi p kt) a_d`` volts, plus a neglected ``L m/(2 pi p kt)`` per unit of
jerk.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..solver.component import Component, Parameter, symbol
from .feed_forward import REFERENCES, acceleration_forward
from .limited import U_MAX, tracked_integral, tracking_time, voltage_law
from .rigid_axis import rigid_axis

VELOCITY_TIME = 0.11
"""Closed-loop time of the velocity loop [s]: an 8 cm step stays within the 36 V of the motor."""

TUNABLE = {"Kx": (0.5, 50.0), "Kp": (0.0, 500.0), "Ki": (100.0, 1e5)}


@dataclass(frozen=True)
class CascadeGains:
    """Kx [1/s], Kp [V*s/m], Ki [V/m], and feed-forward Fv [V*s/m] and Fa [V*s^2/m]."""

    position: float
    proportional: float
    integral: float
    velocity_forward: float
    acceleration_forward: float


def cascade(velocity_time: float = VELOCITY_TIME) -> CascadeGains:
    """The gains for the nominal axis and a closed-loop time of the velocity loop [s]."""
    plant = rigid_axis()
    effective = velocity_time + plant.electrical_time
    proportional = plant.lag / (plant.speed_per_volt * effective)
    return CascadeGains(
        position=1 / (4 * velocity_time),
        proportional=proportional,
        integral=proportional / min(plant.lag, 4 * effective),
        velocity_forward=1 / plant.speed_per_volt,
        acceleration_forward=acceleration_forward(),
    )


def p_pi() -> Component:
    """`u` [V] from x, v, x_d and the derivatives of the set-point, v_d and a_d."""
    gains = cascade()
    rule = f"SIMC rule with a closed-loop time of {VELOCITY_TIME} s"
    inverse = "inverse of the axis without Coulomb friction"
    parameters = (
        Parameter("Kx", gains.position, "1/s", "position gain", "critical damping", minimum=0.0),
        Parameter("Kp", gains.proportional, "V*s/m", "velocity gain", rule, minimum=0.0),
        Parameter("Ki", gains.integral, "V/m", "integral gain on the velocity", rule, minimum=0.0),
        Parameter("Fv", gains.velocity_forward, "V*s/m", "velocity feed-forward", inverse),
        Parameter(
            "Fa", gains.acceleration_forward, "V*s^2/m", "acceleration feed-forward", inverse
        ),
        tracking_time(gains.proportional / gains.integral, "the integral time, Kp/Ki"),
        U_MAX,
    )
    v_d, a_d = symbol("v_d"), symbol("a_d")
    velocity_error = symbol("Kx") * (symbol("x_d") - symbol("x")) + v_d - symbol("v")
    forward = symbol("Fv") * v_d + symbol("Fa") * a_d
    command = symbol("Kp") * velocity_error + symbol("w") + forward
    states = (tracked_integral(symbol("Ki") * velocity_error, command),)
    description = "Position P and velocity PI in cascade, with feed-forward"
    return voltage_law("p_pi", description, parameters, command, states, REFERENCES)
