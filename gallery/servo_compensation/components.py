"""A servo with friction that sticks and slides, and PD laws that compensate the friction."""

import sympy as sp

from ballscrew import (
    Component,
    ForceBalance,
    ForceTerm,
    Input,
    Output,
    Parameter,
    State,
    symbol,
    with_friction,
)

SOURCE = "made for the gallery"
FRICTION = {"Fc": 0.1, "Fs": 0.1, "sigma2": 0.1}  # T_c [N*m] and b [N*m*s/rad]


def servo() -> Component:
    """A rotor driven by a motor; friction sticks and slides as modes."""
    x, v, u = map(symbol, ("x", "v", "u"))
    body = Component(
        name="servo",
        description="A servo motor with an amplifier, and classical friction",
        parameters=(
            Parameter("J", 0.01, "kg*m^2", "inertia", SOURCE, minimum=1e-12),
            Parameter("Kamp", 2.0, "A/V", "gain of the amplifier", SOURCE, minimum=1e-9),
            Parameter("KT", 0.5, "N*m/A", "torque constant", SOURCE, minimum=1e-9),
        ),
        inputs=(Input("u", "V", "input of the amplifier", nominal=1.0, law=("x", "v")),),
        states=(
            State("x", "rad", "angle", v, start=0.3, nominal=0.1),
            State("v", "rad/s", "angular velocity", nominal=1.0),
        ),
        outputs=(
            Output("x", "rad", "angle", x, nominal=0.1),
            Output("v", "rad/s", "angular velocity", v, nominal=1.0),
        ),
        balances=(
            ForceBalance(
                "v",
                symbol("J"),
                (ForceTerm("drive", symbol("Kamp") * symbol("KT") * u, "torque of the motor"),),
            ),
        ),
    )
    return with_friction(body, "classical", FRICTION)


def _law(name: str, description: str, direction: sp.Expr) -> Component:
    """PD control with the model's friction added, in `direction`."""
    x, v, x_d = map(symbol, ("x", "v", "x_d"))
    friction = symbol("Tc_hat") * direction + symbol("b_hat") * v
    command = symbol("Kp") * (x_d - x) - symbol("Kd") * v
    command += friction / (symbol("Kamp_hat") * symbol("KT_hat"))
    return Component(
        name=name,
        description=description,
        parameters=(
            Parameter("Kp", 1.0, "V/rad", "proportional gain", SOURCE, minimum=0.0),
            Parameter("Kd", 0.02, "V*s/rad", "gain on the velocity", SOURCE, minimum=0.0),
            Parameter("Tc_hat", 0.12, "N*m", "Coulomb friction of the model", SOURCE, minimum=0.0),
            Parameter("b_hat", 0.1, "N*m*s/rad", "viscous friction of the model", SOURCE),
            Parameter("Kamp_hat", 2.0, "A/V", "amplifier of the model", SOURCE, minimum=1e-9),
            Parameter("KT_hat", 0.5, "N*m/A", "torque constant of the model", SOURCE, minimum=1e-9),
        ),
        inputs=(
            Input("x", "rad", "measured angle", nominal=0.1, role="measurement"),
            Input("v", "rad/s", "measured angular velocity", nominal=1.0, role="measurement"),
            Input("x_d", "rad", "desired angle", nominal=0.1, role="reference"),
        ),
        outputs=(Output("u", "V", "input of the amplifier", command, nominal=1.0),),
    )


def by_velocity() -> Component:
    """The law by sign(v): at rest it compensates nothing."""
    return _law(
        "by_velocity", "PD control that compensates friction by sign(v)", sp.sign(symbol("v"))
    )


def by_error() -> Component:
    """The law by the error: at rest it compensates in the direction of the error."""
    moving, wanted = sp.sign(symbol("v")), sp.sign(symbol("x_d") - symbol("x"))
    return _law(
        "by_error",
        "PD control that compensates friction by sign(v), and at rest by the sign of the error",
        sp.sign(2 * moving + wanted),
    )
