"""Adaptive friction: the Lyapunov proof's error equation, on the friction that it is proved for."""

import linear_axis as la
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import cumulative_simpson

from ballscrew.controllers.adaptive_friction import adaptive_friction
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.component import symbol
from ballscrew.solver.kernel import Model

DEFAULT = {p.name: p.default for p in adaptive_friction().parameters}
COULOMB = 1.7  # N


def estimate(run):
    return run.states["controller_y"] - DEFAULT["rate"] * la.M * run.outputs["v"] ** 2 / 2


def test_the_error_decays_as_the_proof_says_whatever_is_commanded():
    v = symbol("v")
    sign = v / sp.sqrt(v**2 + DEFAULT["slow"] ** 2)
    plant = la.sliding().substituted({symbol("load"): symbol("load") * sign})
    times = np.concatenate([np.linspace(0, 5e-3, 2001), np.linspace(5e-3, 3, 12001)[1:]])
    run = la.loop(plant, adaptive_friction(), 0.08, 1e-10, plant_load=COULOMB).simulate(times)
    v = run.outputs["v"]
    exponent = cumulative_simpson(
        DEFAULT["rate"] * v**2 / np.hypot(v, DEFAULT["slow"]), x=times, initial=0.0
    )
    error = COULOMB - estimate(run)
    assert np.all(np.diff(np.abs(error)) <= 1e-12)  # the Lyapunov function never grows
    assert error[-1] < 0.03 * COULOMB
    np.testing.assert_allclose(error, COULOMB * np.exp(-exponent), rtol=1e-5)


def test_on_the_plant_s_friction_it_learns_the_coulomb_part():
    """Where the block moves at 5 cm/s, LuGre friction is Fc and the viscous part."""
    model = Model(loop_kernel("plant", "adaptive_friction"))
    model.set_input("x_d", 0.08)
    run = model.simulate([0.0, 1.0])
    assert estimate(run)[-1] == pytest.approx(1.284, rel=0.05)
