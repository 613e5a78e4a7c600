"""A mass on a spring and a moving belt, m x'' + c x' + k x = F(vb - x'), with five friction laws.

The state w is the speed of the mass relative to the belt, x' - vb: if it is zero, the mass sticks.
All motions start sticking, with the spring at rest.
"""

import sympy as sp

from ballscrew import (
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
    with_friction,
)

SOURCE = "ode_friction.m of bSTAB"


def _body(name: str, friction: str) -> Component:
    x, w, m, c, k, vb = (symbol(n) for n in ("x", "w", "m", "c", "k", "vb"))
    v = w + vb
    return Component(
        name=name,
        description=f"A mass on a spring on a moving belt, with {friction}",
        parameters=(
            Parameter("m", 1.0, "kg", "mass", SOURCE, minimum=1e-6),
            Parameter("c", 0.1, "N*s/m", "damping to the ground", SOURCE, minimum=0.0),
            Parameter("k", 1.0, "N/m", "stiffness of the spring", SOURCE, minimum=0.0),
            Parameter("vb", 1.5, "m/s", "speed of the belt", SOURCE),
        ),
        states=(
            State("x", "m", "position", v),
            State("w", "m/s", "speed of the mass on the belt"),
        ),
        outputs=(
            Output("x", "m", "position", x),
            Output("v", "m/s", "velocity", v),
        ),
        balances=(
            ForceBalance(
                "w",
                m,
                (
                    ForceTerm("spring", -k * x, "the spring, to the ground"),
                    ForceTerm("damper", -c * v, "the damper, to the ground"),
                ),
            ),
        ),
    )


def belt() -> Component:
    """Dry friction that falls with the sliding speed as exp(-|w|/v0)."""
    w, fc, fs, v0 = (symbol(n) for n in ("w", "Fc", "Fs", "v0"))
    friction = ForceTerm(
        name="friction",
        force=-sp.sign(w) * (fc + (fs - fc) * sp.exp(-sp.Abs(w) / v0)),
        meaning="dry friction, opposing sliding",
        parameters=(
            Parameter("Fc", 0.5, "N", "friction at high speed", SOURCE, minimum=0.0),
            Parameter("Fs", 1.0, "N", "friction at rest", SOURCE, minimum=0.0),
            Parameter("v0", 0.5, "m/s", "speed over which it falls", SOURCE, minimum=1e-9),
        ),
    )
    body = _body("belt", "dry friction that falls exponentially")
    return with_friction(body, friction, velocity="w")


def belt_coulomb() -> Component:
    """Coulomb friction, with a larger static friction."""
    w, fc = symbol("w"), symbol("Fc")
    friction = ForceTerm(
        name="friction",
        force=-sp.sign(w) * fc,
        meaning="Coulomb friction, opposing sliding",
        parameters=(
            Parameter("Fc", 0.5, "N", "friction while it slides", SOURCE, minimum=0.0),
            Parameter("Fs", 1.0, "N", "largest friction while it sticks", SOURCE, minimum=0.0),
        ),
    )
    body = _body("belt_coulomb", "Coulomb friction and stiction")
    return with_friction(body, friction, velocity="w", breakaway=symbol("Fs"))


def belt_classical() -> Component:
    """Classical friction: it falls as exp(-(w/Vs)^2), so that it is flat at rest."""
    values = {"Fc": 0.5, "Fs": 1.0, "Vs": 0.5, "sigma2": 0.0}
    body = _body("belt_classical", "classical friction")
    return with_friction(body, "classical", values, velocity="w")


def belt_lugre() -> Component:
    """LuGre friction with the same fall, and bristles that bend by a millimetre."""
    values = {"Fc": 0.5, "Fs": 1.0, "Vs": 0.5, "sigma0": 1e3, "sigma1": 10.0, "sigma2": 0.0}
    return with_friction(_body("belt_lugre", "LuGre friction"), "lugre", values, velocity="w")


def belt_dahl() -> Component:
    """Dahl friction, which does not fall with speed."""
    values = {"Fc": 0.5, "sigma": 1e3}
    return with_friction(_body("belt_dahl", "Dahl friction"), "dahl", values, velocity="w")
