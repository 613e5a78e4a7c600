"""A drive of two masses with a compliant screw and backlash, and the usual cascade controller."""

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


def drive() -> Component:
    """Motor and table, as masses along the axis; the screw pushes beyond the backlash."""
    x, v, xm, vm, k, b = (symbol(n) for n in ("x", "v", "xm", "vm", "k", "b"))
    lead = xm - x
    push = k * (lead - sp.Min(sp.Max(lead, -b), b))
    screw = "force of the screw"
    return Component(
        name="backlash_drive",
        description="Two masses, a compliant screw and backlash between them",
        parameters=(
            Parameter("Mm", 10.0, "kg", "mass of the motor", SOURCE, minimum=1e-6),
            Parameter("M", 50.0, "kg", "mass of the table", SOURCE, minimum=1e-6),
            Parameter("D", 200.0, "N*s/m", "viscous friction of the table", SOURCE, minimum=0.0),
            Parameter("k", 1e6, "N/m", "stiffness of the screw", SOURCE, minimum=0.0),
            Parameter("b", 1e-5, "m", "half of the backlash", SOURCE, minimum=0.0),
        ),
        inputs=(Input("u", "N", "force of the motor", nominal=10.0, law=("x", "v", "xm", "vm")),),
        states=(
            State("x", "m", "position of the table", v, start=2e-5, nominal=1e-5),
            State("v", "m/s", "velocity of the table", nominal=1e-3),
            State("xm", "m", "position of the motor", vm, start=2e-5, nominal=1e-5),
            State("vm", "m/s", "velocity of the motor", nominal=1e-3),
        ),
        outputs=(
            Output("x", "m", "position of the table", x, nominal=1e-5),
            Output("v", "m/s", "velocity of the table", v, nominal=1e-3),
            Output("xm", "m", "position of the motor", xm, nominal=1e-5),
            Output("vm", "m/s", "velocity of the motor", vm, nominal=1e-3),
            Output("lead", "m", "by which the motor leads", lead, nominal=1e-5),
            Output("push", "N", screw, push, nominal=10.0),
        ),
        balances=(
            ForceBalance(
                "v",
                symbol("M"),
                (
                    ForceTerm("screw", push, screw),
                    ForceTerm("guide", -symbol("D") * v, "viscous friction"),
                ),
            ),
            ForceBalance(
                "vm",
                symbol("Mm"),
                (ForceTerm("motor", symbol("u"), "motor"), ForceTerm("screw_back", -push, screw)),
            ),
        ),
    )


def dry_drive() -> Component:
    """The drive with Coulomb friction at the table, which sticks and slides."""
    return with_friction(drive(), "classical", {"Fc": 1.0, "Fs": 1.0, "sigma2": 0.0})


def _cascade(name: str, description: str, position: str) -> Component:
    """A proportional law of the position, and a PI law of the motor's velocity."""
    error = symbol("Kx") * (symbol("x_d") - symbol(position)) - symbol("vm")
    return Component(
        name=name,
        description=description,
        parameters=(
            Parameter("Kx", 60.0, "1/s", "position gain", SOURCE, minimum=0.0),
            Parameter("Kp", 6000.0, "N*s/m", "velocity gain", SOURCE, minimum=0.0),
            Parameter("Ki", 1.5e5, "N/m", "integral gain of the velocity", SOURCE, minimum=0.0),
        ),
        inputs=(
            *(
                Input(n, "m", f"position of the {of}", nominal=1e-5, role="measurement")
                for n, of in (("x", "table"), ("xm", "motor"))
            ),
            *(
                Input(n, "m/s", f"velocity of the {of}", nominal=1e-3, role="measurement")
                for n, of in (("v", "table"), ("vm", "motor"))
            ),
            Input("x_d", "m", "desired position", nominal=1e-5, role="reference"),
        ),
        states=(State("w", "N", "integral part", symbol("Ki") * error, nominal=10.0),),
        outputs=(
            Output(
                "u", "N", "force of the motor", symbol("Kp") * error + symbol("w"), nominal=10.0
            ),
        ),
    )


def table_loop() -> Component:
    """The cascade with a scale at the table."""
    return _cascade("table_loop", "Position of the table, velocity of the motor", "x")


def motor_loop() -> Component:
    """The cascade with the motor's encoder only."""
    return _cascade("motor_loop", "Position and velocity of the motor", "xm")
