"""A mass on a plane with dry friction that sticks, and a PID controller of its position."""

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

EXAMPLE = "example of Canudas de Wit et al. (1995) as in auralius/LuGre, sim_pid.m and demo2.m"
FRICTION = {"Fc": 1.0, "Fs": 1.5, "Vs": 1e-3, "sigma2": 0.4}


def mass() -> Component:
    """The mass, moved by a force; it sticks and slides as modes."""
    x, v, u, m = map(symbol, ("x", "v", "u", "m"))
    body = Component(
        name="mass",
        description="A mass on a plane with Coulomb friction and stiction",
        parameters=(Parameter("m", 1.0, "kg", "mass", EXAMPLE, minimum=1e-6),),
        inputs=(Input("u", "N", "force on the mass", nominal=1.0, law=("x", "v")),),
        states=(
            State("x", "m", "position", v, nominal=1e-2),
            State("v", "m/s", "velocity", nominal=1e-2),
        ),
        outputs=(
            Output("x", "m", "position", x, nominal=0.1),
            Output("v", "m/s", "velocity", v, nominal=0.1),
        ),
        balances=(ForceBalance("v", m, (ForceTerm("drive", u, "force on the mass"),)),),
    )
    return with_friction(body, "classical", FRICTION)


def pid_law() -> Component:
    """The PID controller, with the derivative of the measured position."""
    x, v, x_d, w = map(symbol, ("x", "v", "x_d", "w"))
    error = x_d - x
    return Component(
        name="pid_law",
        description="PID controller of the position",
        parameters=(
            Parameter("Kp", 3.0, "N/m", "proportional gain", EXAMPLE, minimum=0.0),
            Parameter("Ki", 4.0, "N/(m*s)", "integral gain", EXAMPLE, minimum=0.0),
            Parameter("Kd", 6.0, "N*s/m", "gain on the velocity", EXAMPLE, minimum=0.0),
        ),
        inputs=(
            Input("x", "m", "measured position", nominal=0.1, role="measurement"),
            Input("v", "m/s", "measured velocity", nominal=0.1, role="measurement"),
            Input("x_d", "m", "desired position", nominal=0.1, role="reference"),
        ),
        states=(State("w", "m*s", "integral of the error", error, nominal=1e-2),),
        outputs=(
            Output(
                "u",
                "N",
                "force command",
                symbol("Kp") * error + symbol("Ki") * w - symbol("Kd") * v,
                nominal=1.0,
            ),
        ),
    )
