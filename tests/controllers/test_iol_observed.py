"""The observer behind the linearizing controller: its poles, and the loop that it leaves as it
was."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers.iol_observed import POLE
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.kernel import Model


def run_of(times, plant=None, **values):
    given = {"plant_" + k: v for k, v in (plant or {}).items()}
    given |= {"controller_" + k: v for k, v in values.items()}
    model = Model(loop_kernel("plant", "iol_observed"), given, 1e-10)
    model.set_input("x_d", 0.08)
    return model.simulate(times)


def test_a_wrong_start_of_the_position_decays_with_the_observer_s_pole():
    times = np.linspace(0.0, 0.08, 81)
    run = run_of(times, x_hat_start=1e-3)
    error = run.states["controller_x_hat"] - run.states["plant_x"]
    np.testing.assert_allclose(error, 1e-3 * np.exp(-POLE * times), atol=1e-10)


@pytest.mark.ci
def test_a_wrong_velocity_decays_with_the_poles_of_the_sliding_plant():
    """From 5 cm/s on, both sides slide: the errors of v and i obey the linear axis'
    equations."""
    times = np.linspace(0.0, 2e-3, 201)
    start = {"v_start": 0.05, "z_start": 1.284 / 66967.231, "i_start": 0.05}
    run = run_of(times, start, v_hat_start=0.06, z_hat_start=start["z_start"], i_hat_start=0.05)
    a, _ = la.matrices()
    values, vectors = np.linalg.eig(a[1:, 1:])
    assert sorted(values.real) == pytest.approx([-19444.9, -3183.6], rel=1e-4)
    shares = np.linalg.solve(vectors, [0.01, 0.0])
    exact = (vectors * shares) @ np.exp(np.outer(values, times))
    for row, name in enumerate("vi"):
        error = run.states[f"controller_{name}_hat"] - run.states[f"plant_{name}"]
        np.testing.assert_allclose(error, exact[row], atol=1e-3 * np.abs(exact[row]).max())


@pytest.mark.ci
def test_friction_that_is_a_tenth_off_leaves_less_than_ten_micrometres():
    run = run_of(np.array([0.0, 5.0]), {"Fc": 1.5, "sigma2": 190.0})
    assert abs(run.outputs["x"][-1] - 0.08) < 1e-5
