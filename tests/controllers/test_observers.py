"""What laws that estimate friction or a load come to: the friction, the load, and their bounds."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers.adaptive_friction import adaptive_friction
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
