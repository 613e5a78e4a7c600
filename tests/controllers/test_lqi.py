"""LQI: the Riccati solution against the Hamiltonian's eigenvalues and a simulated cost."""

import linear_axis as la
import numpy as np

from ballscrew.controllers.lqi import lq_design, rest_sliding

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
