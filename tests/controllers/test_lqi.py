"""LQI: the Riccati solution against the Hamiltonian's eigenvalues and a simulated cost."""

import linear_axis as la
import numpy as np
import pytest
from scipy.integrate import simpson

from ballscrew.controllers.lqi import lq_design, lqi, rest_sliding

DESIGN = lq_design()
WEIGHT = 1 / 36.0**2  # of the voltage


def test_the_plant_s_equations_in_sliding_are_the_linear_axis():
    for derived, by_hand in zip(rest_sliding(), la.matrices(), strict=True):
        np.testing.assert_allclose(derived, by_hand, rtol=1e-12, atol=1e-9)


def test_the_closed_loop_has_the_stable_eigenvalues_of_the_hamiltonian():
    a, b = DESIGN.dynamics, DESIGN.effect
    hamiltonian = np.block([[a, -b @ b.T / WEIGHT], [-DESIGN.weights, -a.T]])
    wanted = np.linalg.eigvals(hamiltonian)
    wanted = np.sort_complex(wanted[wanted.real < 0])
    found = np.sort_complex(np.linalg.eigvals(a - b @ DESIGN.gains[None]))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_a_simulated_step_costs_what_the_riccati_solution_says():
    """A step of 1 cm, which the limit does not reach; the error is -1 cm at first."""
    times = np.concatenate([np.linspace(0, 0.01, 2001), np.linspace(0.01, 12, 24001)[1:]])
    model = la.loop(la.sliding(), lqi(), 0.01, 1e-11)
    run = model.simulate(times)
    error = run.outputs["x"] - 0.01
    integral = -run.states["controller_w"] / {p.name: p.default for p in lqi().parameters}["Ki"]
    state = np.array([error, run.outputs["v"], run.outputs["i"], integral])
    rate = np.einsum("it,ij,jt->t", state, DESIGN.weights, state) + WEIGHT * run.outputs["u"] ** 2
    start = np.array([-0.01, 0, 0, 0])
    assert simpson(rate, x=times) == pytest.approx(start @ DESIGN.cost @ start, rel=1e-4)
