"""A mass on a spring with dry friction, driven by a harmonic force.

    m x'' + k x + F sign(x') = P cos(w t),    w = b sqrt(k/m)

At rest, friction holds the mass, with a force of up to F.
"""

import sympy as sp

from ballscrew import (
    TIME,
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
    with_friction,
)

SOURCE = "made for the gallery"


def driven() -> Component:
    """The mass without friction; `b` is the frequency of the force over that of mass and spring."""
    x, v, m, k, push, b = (symbol(n) for n in ("x", "v", "m", "k", "P", "b"))
    drive = push * sp.cos(b * sp.sqrt(k / m) * TIME)
    return Component(
        name="forced_friction",
        description="A mass on a spring, driven by a force that swings",
        parameters=(
            Parameter("m", 1.0, "kg", "mass", SOURCE, minimum=1e-6),
            Parameter("k", 1.0, "N/m", "stiffness of the spring", SOURCE, minimum=1e-6),
            Parameter("P", 1.0, "N", "amplitude of the force that swings", SOURCE, minimum=0.0),
            Parameter(
                "b",
                0.6,
                "1",
                "frequency of the force over that of mass and spring",
                SOURCE,
                minimum=1e-3,
            ),
        ),
        states=(
            State("x", "m", "displacement", v),
            State("v", "m/s", "velocity"),
        ),
        outputs=(
            Output("x", "m", "displacement", x),
            Output("v", "m/s", "velocity", v),
        ),
        balances=(
            ForceBalance(
                "v",
                m,
                (
                    ForceTerm("drive", drive, "the force that swings"),
                    ForceTerm("spring", -k * x, "pull of the spring"),
                ),
            ),
        ),
    )


def oscillator() -> Component:
    """The mass with Coulomb friction, with equal static and sliding friction."""
    friction = ForceTerm(
        "friction",
        -symbol("F") * sp.sign(symbol("v")),
        "Coulomb friction, opposing motion",
        parameters=(Parameter("F", 0.3, "N", "Coulomb friction", SOURCE, minimum=0.0),),
    )
    return with_friction(driven(), friction)
