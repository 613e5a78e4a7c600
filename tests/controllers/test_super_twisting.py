"""Super-twisting: finite time in closed form, a growing load, and the smoothed surface."""

import linear_axis as la
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from ballscrew.controllers.super_twisting import super_twisting
from ballscrew.solver.component import TIME, symbol

DEFAULT = {p.name: p.default for p in super_twisting().parameters}
C, SLOPE = DEFAULT["C"], DEFAULT["slope"]
K1, K2 = DEFAULT["k1"] * np.sqrt(C), DEFAULT["k2"] * C
THIN = 1e-7  # layer, m/s


def surface(run):
    return run.outputs["v"] + SLOPE * (run.outputs["x"] - 0.08)


def time_to_the_surface(s):
    """Exact, without load: in sqrt(|s|) sign(s) and y, and in the time dt/sqrt(|s|), it is linear.

    So the time is the integral of the first of both along exp(A tau), over all tau.
    """
    a = np.array([[-K1 / 2, 0.5], [-K2, 0.0]])
    start = np.array([np.sqrt(s), 0.0])
    total, _ = quad(lambda tau: abs((expm(a * tau) @ start)[0]), 0, 12, limit=400)
    return total


def test_s_is_zero_after_the_exact_finite_time_and_not_before():
    time = time_to_the_surface(SLOPE * 0.08)
    run = la.loop(la.rigid(), super_twisting(), 0.08, 1e-10, u_max=1e3, layer=THIN).simulate(
        [0.0, 0.9 * time, 1.01 * time]
    )
    s = np.abs(surface(run))
    assert s[1] > 1e-4
    assert s[2] < 2 * THIN


def test_a_load_that_grows_slower_than_the_bound_is_held_off_the_surface():
    """|dd/dt| = 0.9 C: an exact sign keeps s at zero, the smoothed one within its layer."""
    growth = 0.9 * K2 / 1.1 * la.M  # N/s
    plant = la.rigid().substituted({symbol("load"): symbol("load") * TIME})
    model = la.loop(plant, super_twisting(), 0.08, 1e-9, u_max=1e3, plant_load=growth)
    run = model.simulate(np.linspace(0.0, 0.6, 61))
    settled = np.abs(surface(run))[40:]
    layer = DEFAULT["layer"]
    # in the layer y follows a ramp of the load where k2 s/layer is its growth
    assert settled == pytest.approx(0.9 / 1.1 * layer, rel=1e-3)
