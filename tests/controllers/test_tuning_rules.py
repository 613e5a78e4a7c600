"""Gains of PID, P-PI and LQI by their rules, worked by hand; the sampled PID's arithmetic."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers.lqi import lq_design, rest_sliding
from ballscrew.controllers.p_pi import VELOCITY_TIME, cascade
from ballscrew.controllers.pid import simc
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model


def test_simc_gains_follow_the_rule_for_an_integrating_process_with_a_lag():
    assert pytest.approx(0.00398, rel=2e-3) == la.B  # m/s per volt, as 30 V give 0.119 m/s
    time, g = 0.6 + la.L / la.R, simc()
    assert g.proportional == pytest.approx(1 / (la.B * time) * (1 + la.LAG / (4 * time)))
    assert g.integral == pytest.approx(1 / (la.B * time) / (4 * time))
    assert g.derivative == pytest.approx(la.LAG / (la.B * time))


def test_sampled_pid_does_the_difference_equation_at_its_samples():
    model, gains = Model(generate(component("pid_sampled"))), simc()
    integral, last = 0.0, 0.0
    for k, position in enumerate([0.0, 0.001, 0.003, 0.002]):
        model.set_input("x", position)
        model.set_input("x_d", 0.08)
        model.sample(k * 1e-3)
        error, speed, last = 0.08 - position, (position - last) / 1e-3, position
        integral += 1e-3 * error
        expected = gains.proportional * error + gains.integral * integral - gains.derivative * speed
        assert model.outputs(k * 1e-3, model.x)["u"] == pytest.approx(expected, rel=1e-12)


def test_gains_of_the_cascade_place_the_poles_that_the_rule_says():
    """The PI cancels the lag, so the speed follows like 1/(T s + 1), and T s^2 + s + Kx = 0."""
    time, gains = VELOCITY_TIME + la.L / la.R, cascade()
    assert gains.proportional == pytest.approx(la.LAG / (la.B * time), rel=1e-12)
    assert gains.integral == pytest.approx(1 / (la.B * time), rel=1e-12)
    assert gains.position == pytest.approx(1 / (4 * VELOCITY_TIME), rel=1e-12)


def test_the_riccati_solution_has_the_stable_eigenvalues_of_the_hamiltonian():
    """Of the plant's equations in sliding, which are those of the linear axis."""
    for derived, by_hand in zip(rest_sliding(), la.matrices(), strict=True):
        np.testing.assert_allclose(derived, by_hand, rtol=1e-12, atol=1e-9)
    design, weight = lq_design(), 1 / 36.0**2  # of the voltage
    a, b = design.dynamics, design.effect
    wanted = np.linalg.eigvals(np.block([[a, -b @ b.T / weight], [-design.weights, -a.T]]))
    wanted = np.sort_complex(wanted[wanted.real < 0])
    found = np.sort_complex(np.linalg.eigvals(a - b @ design.gains[None]))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
