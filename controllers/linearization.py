"""Input-output linearization of the ball-screw axis (Eqs. 3.17-3.22 of the thesis).

The law is derived from the plant's own equations by differentiation. With estimates instead of
the friction parameters it cancels the estimated plant dynamics, and places the poles at
``-5, -6, -7`` 1/s.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..plant.ball_screw import ball_screw
from ..solver.component import Component, ForceTerm, Parameter, symbol
from .limited import measurements_of, plain_output

POLES = (-5.0, -6.0, -7.0)

TUNABLE = {"k0": (20.0, 5e3), "k1": (10.0, 2e3), "k2": (2.0, 200.0)}


def gains_from_poles(poles: tuple[float, float, float]) -> tuple[float, float, float]:
    """Coefficients (k0, k1, k2) of ``s^3 + k2 s^2 + k1 s + k0`` with these real poles [1/s]."""
    s = sp.Symbol("s")
    _, k2, k1, k0 = sp.Poly(sp.prod([s - sp.Float(p) for p in poles]), s).all_coeffs()
    return float(k0), float(k1), float(k2)


def input_output_linearization(acceleration: str = "estimated") -> Component:
    """The linearizing controller: `u` [V] from x, v, z, i and the set-point x_d; no states.

    The block's acceleration is computed with the estimated friction parameters, as in a real
    controller, or with the "true" ones, which are then also parameters of the controller, under the
    plant's names. The thesis does not say which it used.
    """
    if acceleration not in ("estimated", "true"):
        raise ValueError(f"acceleration is {acceleration!r}, expected 'estimated' or 'true'")
    plant = ball_screw()
    friction = next(t for t in plant.terms if t.name == "friction")
    hats, estimates, sharpness = estimates_of(friction)
    x, x_d, u = map(symbol, ("x", "x_d", "u"))

    acceleration_true = plant.derivative("v")
    states = [symbol(s.name) for s in plant.all_states]
    jerk = sum(sp.diff(acceleration_true, s) * plant.derivative(s.name) for s in states)
    drift, gain = jerk.subs(u, 0), sp.diff(jerk, u)
    measured = acceleration_true if acceleration == "true" else acceleration_true.xreplace(hats)
    demand = -symbol("k2") * measured - symbol("k1") * symbol("v") - symbol("k0") * (x - x_d)
    law = (demand - drift.xreplace(hats)) / gain

    k0, k1, k2 = gains_from_poles(POLES)
    source = "Eq. 3.21: poles at -5, -6, -7 1/s"
    return Component(
        name="iol" if acceleration == "estimated" else "iol_true_acceleration",
        description="Input-output linearization with estimated friction parameters",
        parameters=(
            Parameter("k0", k0, "1/s^3", "gain on the position error", source, minimum=0.0),
            Parameter("k1", k1, "1/s^2", "gain on the velocity", source, minimum=0.0),
            Parameter("k2", k2, "1/s", "gain on the acceleration", source, minimum=0.0),
            *estimates,
            *plant.parameters,
            *(friction.parameters if acceleration == "true" else (sharpness,)),
        ),
        inputs=measurements_of(plant),
        outputs=(plain_output(law),),
    )


def estimates_of(
    friction: ForceTerm,
) -> tuple[dict[sp.Symbol, sp.Symbol], tuple[Parameter, ...], Parameter]:
    """A controller's estimates of the parameters of modified LuGre friction.

    Returns each parameter's symbol to that of its estimate, ``<name>_hat``; the estimates, with the
    parameters' values as defaults; and the sharpness of the smooth sign, which is part of the model
    and is not estimated.
    """
    sharpness = next(p for p in friction.parameters if p.name == "Kv")
    known = [p for p in friction.parameters if p is not sharpness]
    return (
        {symbol(p.name): symbol(p.name + "_hat") for p in known},
        tuple(
            replace(p, name=p.name + "_hat", meaning="estimate of the " + p.meaning) for p in known
        ),
        sharpness,
    )


def with_true_acceleration() -> Component:
    """The variant whose feedback knows the block's true acceleration."""
    return input_output_linearization("true")
