"""What time moves again is not at rest, however still it stands at the end of a run."""

import math
from functools import cache

import pytest
import sympy as sp
from known_systems import maker

from ballscrew.plant.with_friction import with_friction
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import lyapunov

W = 0.3
PERIOD = 2 * math.pi / W


@cache
def mass():
    """A unit mass on a unit spring with Coulomb friction F, pulled by cos(w t)."""
    body = Component(
        "mass",
        "a mass with a force",
        parameters=(Parameter("w", W, "rad/s", "frequency", "made up"),),
        states=(State("x", "m", "x", symbol("v")), State("v", "m/s", "v")),
        outputs=(Output("x", "m", "x", symbol("x")),),
        balances=(
            ForceBalance(
                "v",
                sp.Integer(1),
                (ForceTerm("force", sp.cos(symbol("w") * TIME) - symbol("x"), "force"),),
            ),
        ),
    )
    return generate(with_friction(body, "classical", {"sigma2": 0.0}))


def becomes(friction, periods, start=0.0):
    values = {"Fc": friction, "Fs": friction, "x_start": start}
    return lyapunov(maker(mass(), values), periods * PERIOD, 1e-9).motion


@pytest.mark.ci
@pytest.mark.parametrize("periods", [2.0, 30.0, 30.05])
def test_a_mass_that_sticks_at_the_end_of_a_run_is_in_a_cycle_if_its_force_moves_it_again(periods):
    motion = becomes(0.6, periods)
    assert motion.kind is Kind.CYCLE, motion.evidence
    assert motion.period == pytest.approx(PERIOD, rel=1e-6)


@pytest.mark.parametrize("start", [0.0, 0.04])
def test_a_mass_that_its_force_never_moves_is_stuck(start):
    motion = becomes(1.05, 20.0, start)
    assert motion.kind is Kind.LINE, motion.evidence
    assert motion.equilibrium.state[0] == start
