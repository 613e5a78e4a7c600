"""Two components as one: what a mode of the plant says holds in the controller's equations, too."""

import math

import pytest
import sympy as sp

import ballscrew
from ballscrew.solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Input,
    Output,
    State,
    symbol,
)

COULOMB, EXTRA, DAMPING = 1.0, 0.5, 0.4


def mass():
    """One kilogram with Coulomb friction that sticks."""
    x, v, u = map(symbol, ("x", "v", "u"))
    body = Component(
        name="mass",
        description="a mass that sticks and slides",
        inputs=(Input("u", "N", "force", law=("x", "v")),),
        states=(State("x", "m", "position", v, start=8.0), State("v", "m/s", "velocity")),
        outputs=(Output("x", "m", "position", x), Output("v", "m/s", "velocity", v)),
        balances=(ForceBalance("v", sp.Integer(1), (ForceTerm("drive", u, "force"),)),),
    )
    friction = {"Fc": COULOMB, "Fs": COULOMB, "sigma2": 0.0}
    return ballscrew.with_friction(body, "classical", friction)


def law():
    """A spring and a damper, and more than the friction in the direction of motion."""
    x, v, x_d = map(symbol, ("x", "v", "x_d"))
    push = (COULOMB + EXTRA) * sp.sign(v)
    return Component(
        name="law",
        description="pushes in the direction of motion",
        inputs=(
            Input("x", "m", "position", role="measurement"),
            Input("v", "m/s", "velocity", role="measurement"),
            Input("x_d", "m", "goal", role="reference"),
        ),
        states=(State("speed", "m/s", "filtered speed", sp.Abs(v) - symbol("speed")),),
        outputs=(Output("u", "N", "force", x_d - x - DAMPING * v + push),),
    )


def test_a_cycle_of_a_law_with_a_sign_has_its_exponent_in_closed_form():
    found = ballscrew.lyapunov(law(), mass(), stop=100.0, reference=0.0).motion
    frequency = math.sqrt(1.0 - DAMPING**2 / 4)
    ratio = math.exp(-math.pi * DAMPING / 2 / frequency)
    assert found.kind.value == "limit cycle"
    assert found.period == pytest.approx(2 * math.pi / frequency, rel=1e-7)
    swing = EXTRA * (1 + ratio) / (1 - ratio)
    assert found.amplitude["plant_x"] == pytest.approx(swing, rel=1e-3)
    assert found.limit == pytest.approx([0.0, -DAMPING / 2, -1.0], abs=1e-4)
