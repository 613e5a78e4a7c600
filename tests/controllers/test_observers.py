"""What laws that estimate friction, a load or states come to, and the poles of their observers."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers.adaptive_friction import adaptive_friction
from ballscrew.controllers.iol_observed import POLE
from ballscrew.controllers.pid import pid, simc
from ballscrew.controllers.pid_dob import pid_dob
from ballscrew.controllers.pid_lugre import pid_lugre
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

PLANT = {p.name: p.default for p in component("plant").all_parameters}
LOAD = 20.0  # N


def test_on_the_plant_s_friction_the_adaptive_law_learns_the_coulomb_part():
    """Where the block moves at 5 cm/s, LuGre friction is Fc and the viscous part."""
    model = Model(loop_kernel("plant", "adaptive_friction"))
    model.set_input("x_d", 0.08)
    run = model.simulate([0.0, 1.0])
    (rate,) = (p.default for p in adaptive_friction().parameters if p.name == "rate")
    estimate = run.states["controller_y"] - rate * la.M * run.outputs["v"] ** 2 / 2
    assert estimate[-1] == pytest.approx(1.284, rel=0.05)
    assert np.exp(-0.08 * rate) == pytest.approx(0.02, rel=0.1)  # as the parameter says


def test_a_load_is_taken_away_without_an_integral():
    ends = {}
    for law in (pid(), pid_dob()):
        model = la.loop(la.sliding(), law, 0.08, 1e-9, Ki=0.0, plant_load=LOAD)
        ends[law.name] = model.simulate([0.0, 20.0]).outputs["x"][-1] - 0.08
    gain = simc().proportional
    assert ends["pid"] == pytest.approx(-LOAD * la.R / la.MOTOR / gain, rel=1e-6)
    assert abs(ends["pid_dob"]) < 1e-9


def test_the_condition_of_the_lugre_observer_s_theorem_holds_with_the_default_gains():
    """(sigma1 s + sigma0)/(m s^2 + H(s)) has no negative real part on the imaginary axis."""
    gains, per_volt = simc(), la.MOTOR / la.R
    s = 1j * np.logspace(-4, 6, 4001)
    pid_part = gains.derivative * s + gains.proportional + gains.integral / s
    rest = la.DAMPING * s + per_volt * pid_part
    response = (PLANT["sigma1"] * s + PLANT["sigma0"]) / (la.M * s**2 + rest)
    assert response.real.min() > 0


def test_the_estimate_stays_within_static_friction_while_a_stuck_block_is_far_away():
    model = Model(generate(pid_lugre()))
    model.set_input("x_d", 1.0)
    run = model.simulate([0.0, 1.0, 100.0])
    assert run.states["z_hat"][-1] == pytest.approx(PLANT["Fs"] / PLANT["sigma0"], rel=1e-3)


# -- the observer behind the linearizing controller ----------------------------------------------


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
