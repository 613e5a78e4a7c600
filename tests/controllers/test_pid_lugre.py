"""The LuGre observer: its error along a slide in closed form, and the condition of its theorem."""

import linear_axis as la
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from ballscrew.controllers.pid import simc
from ballscrew.controllers.pid_lugre import pid_lugre
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.codegen import generate
from ballscrew.solver.interconnect import connect
from ballscrew.solver.kernel import Model

PLANT = {p.name: p.default for p in component("plant").all_parameters}


@pytest.mark.ci
def test_the_observer_s_error_decays_with_the_distance_that_the_block_slides():
    """Without correction d(z - z_hat)/dt = -sigma0 S v/g(v) (z - z_hat), whatever is commanded."""
    values = {"controller_k": 0.0, "controller_z_hat_start": 3e-5}
    model = Model(generate(connect(component("plant"), pid_lugre())), values, 1e-10)
    model.set_input("x_d", 0.08)
    run = model.simulate(np.linspace(0.0, 2e-3, 4001))
    v = run.outputs["v"]
    sign = 2 / np.pi * np.arctan(PLANT["Kv"] * v)
    stribeck = PLANT["Fc"] + (PLANT["Fs"] - PLANT["Fc"]) * np.exp(-((v / PLANT["Vs"]) ** 2))
    exponent = cumulative_simpson(PLANT["sigma0"] * sign * v / stribeck, x=run.time, initial=0.0)
    error = run.states["controller_z_hat"] - run.states["plant_z"]
    assert error[-1] < 0.05 * error[0]
    np.testing.assert_allclose(error, 3e-5 * np.exp(-exponent), rtol=1e-4)


def test_the_theorem_s_condition_holds_with_the_default_gains():
    """(sigma1 s + sigma0)/(m s^2 + H(s)) has no negative real part on the imaginary axis."""
    gains, per_volt = simc(), la.MOTOR / la.R
    s = 1j * np.logspace(-4, 6, 4001)
    rest = la.DAMPING * s + per_volt * (
        gains.derivative * s + gains.proportional + gains.integral / s
    )
    response = (PLANT["sigma1"] * s + PLANT["sigma0"]) / (la.M * s**2 + rest)
    assert response.real.min() > 0


def test_the_estimate_stays_within_static_friction_while_a_stuck_block_is_far_away():
    model = Model(generate(pid_lugre()))
    model.set_input("x_d", 1.0)
    run = model.simulate([0.0, 1.0, 100.0])
    assert run.states["z_hat"][-1] == pytest.approx(PLANT["Fs"] / PLANT["sigma0"], rel=1e-3)
