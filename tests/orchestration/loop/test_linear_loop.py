"""Linearized loops, against transfer functions written by hand and against the running loop."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ballscrew.orchestration.loop.linear_loop import (
    linear_kernel,
    linearized,
    margins_of,
    open_loop,
)
from ballscrew.orchestration.loop.machine import Machine
from ballscrew.orchestration.loop.parts import Part
from ballscrew.orchestration.loop.reference_motions import sine
from ballscrew.orchestration.loop.whole_loop import follow, loop_kernel
from ballscrew.solver.kernel import Model

MASS, DAMPING = 40.0, 200.0
RIGID = {"m": MASS, "sigma2": DAMPING, "Fc": 80.0, "Fs": 90.0, "Vs": 1e-3}
BRISTLES = {**RIGID, "sigma0": 1e7, "sigma1": 2e4}
KP, KI, KD = 2e4, 2e5, 400.0
GAINS = {"Kp": KP, "Ki": KI, "Kd": KD}
PERIOD = 2e-3


def law(name, values, sampled=0):
    kernel = linear_kernel(Part(name), ("x", "v"), ("u",))
    return linearized(kernel, ("x", "v"), ("u",), values, {}, sampled=sampled)


def sliding(outputs=("x", "v")):
    """A body whose friction is a damper: far from the Stribeck speed the curve has one slope."""
    machine = Machine(Part("drive_classical"), RIGID, 500.0)
    return machine.linear(outputs, machine.sliding(0.2))


def by_hand(w):
    s = 1j * w
    return (KD * s**2 + KP * s + KI) / (s**2 * (MASS * s + DAMPING))


def test_margins_of_a_pid_on_a_mass_with_a_damper_are_those_of_its_transfer_function():
    found = margins_of(open_loop(sliding(), law("pid", GAINS)), "sliding", 0.2)
    # |KI - KD w^2 + i KP w|^2 = w^4 |DAMPING + i MASS w|^2, a cubic in w^2
    squares = np.roots([MASS**2, DAMPING**2 - KD**2, 2 * KI * KD - KP**2, -(KI**2)])
    crossovers = np.sqrt([s.real for s in squares if abs(s.imag) < 1e-9 * abs(s) and s.real > 0])
    assert len(crossovers) == 1
    phase = 180 + np.degrees(np.angle(by_hand(crossovers[0])))
    assert found.phase_margin == pytest.approx((phase + 180) % 360 - 180, rel=1e-6)
    assert found.crossover == pytest.approx(crossovers[0] / (2 * np.pi), rel=1e-6)
    # the imaginary part of L is zero where KP DAMPING = MASS (KI - KD w^2)
    turn = np.sqrt((MASS * KI - KP * DAMPING) / (MASS * KD))
    assert found.gain_margin_down == pytest.approx(1 / abs(by_hand(turn)), rel=1e-6)
    assert np.isinf(found.gain_margin)
    worst = minimize_scalar(lambda w: abs(1 + by_hand(w)), bounds=(5, 100), options={"xatol": 1e-9})
    assert found.sensitivity == pytest.approx(1 / worst.fun, rel=1e-6)
    assert found.stable
    np.testing.assert_allclose(found.response, by_hand(2 * np.pi * found.frequency), rtol=1e-9)


def test_a_gain_margin_up_is_where_the_measured_loop_would_turn_unstable():
    """The nominal axis has a lag of the current, so that a gain margin exists."""
    machine = Machine(Part("plant"), {}, 36.0)
    plant = machine.linear(("x", "v"), machine.sliding(0.05))
    gains = {"Kp": 3e5, "Ki": 1e4, "Kd": 0.5}
    found = margins_of(open_loop(plant, law("pid", gains)), "sliding", 0.05)
    assert 1 < found.gain_margin < 1e6
    for factor, stable in ((0.999, True), (1.001, False)):
        scaled = {n: factor * found.gain_margin * g for n, g in gains.items()}
        loop = open_loop(plant, law("pid", scaled))
        assert margins_of(loop, "sliding", 0.05).stable == stable


def test_a_sampled_pid_is_its_difference_equation_on_the_held_plant():
    loop = open_loop(sliding(), law("pid_sampled", {**GAINS, "sample_time": PERIOD}, 3), PERIOD)
    w = np.array([1.0, 10.0, 100.0, 1000.0])
    z = np.exp(1j * w * PERIOD)
    position, _ = held_plant(z)
    control = KP + KI * PERIOD * z / (z - 1) + KD * (z - 1) / (PERIOD * z)
    np.testing.assert_allclose(loop(z), position * control, rtol=1e-8)


def test_a_sampled_cascade_integrates_what_it_has_read():
    gains = {"Kx": 20.0, "Kp": 2e3, "Ki": 3e4, "u_max": 1e6, "sample_time": PERIOD}
    loop = open_loop(sliding(), law("p_pi+sampled", gains, 6), PERIOD)  # reads five, holds one
    z = np.exp(1j * np.array([1.0, 10.0, 100.0, 1000.0]) * PERIOD)
    position, velocity = held_plant(z)
    control = gains["Kp"] + gains["Ki"] * PERIOD / (z - 1)
    np.testing.assert_allclose(loop(z), control * (20.0 * position + velocity), rtol=1e-8)


def held_plant(z):
    """Position and velocity of 1/(s (MASS s + DAMPING)) behind a zero-order hold."""
    gain, lag = 1 / DAMPING, MASS / DAMPING
    a = np.exp(-PERIOD / lag)
    top = (PERIOD - lag * (1 - a)) * z + lag * (1 - a) - PERIOD * a
    return gain * top / ((z - 1) * (z - a)), gain * (1 - a) / (z - a)


@pytest.mark.parametrize("frequency", [2.0, 20.0])
def test_the_running_loop_answers_a_small_sine_as_the_stuck_loop_says(frequency):
    gains = {"Kp": 5e6, "Ki": 1e8, "Kd": 2e4}
    machine = Machine(Part("drive_lugre"), BRISTLES, 500.0)
    plant = machine.linear(("x", "v"), machine.stuck())
    s = 2j * np.pi * frequency
    loop = open_loop(plant, law("pid", gains))(s)
    forward = gains["Kp"] + gains["Ki"] / s
    expected = loop / (1 + loop) * forward / (forward + gains["Kd"] * s)
    assert 0.1 < abs(loop) < 10  # the loop decides, not the reference alone

    values = {f"plant_{n}": v for n, v in BRISTLES.items()}
    values |= {f"controller_{n}": v for n, v in gains.items()}
    model = Model(loop_kernel("drive_lugre", "pid"), values, 1e-10)
    amplitude = 1e-8  # m, a thousandth of the way to break-away
    time = np.arange(0.0, 8.0, 1e-3)
    y, stopped = follow(model, sine(amplitude, frequency, 9.0), time)
    assert not stopped
    late = time > 6.0
    phase = 2 * np.pi * frequency * time[late]
    table = np.column_stack([np.cos(phase), np.sin(phase), np.ones(late.sum())])
    even, odd, _ = np.linalg.lstsq(table, y["x"][late], rcond=None)[0]
    measured = (even - 1j * odd) / (-amplitude / 2)  # the set-point is -amplitude/2 cos + constant
    assert abs(measured / expected - 1) < 0.01


def test_bristles_are_a_spring_and_a_damper_while_the_body_is_stuck():
    machine = Machine(Part("drive_lugre"), BRISTLES, 500.0)
    found = machine.command_per_metre(1e-3)
    assert found.real != pytest.approx(1e7, rel=1e-3)  # sliding has no spring
    plant = machine.linear(("x",), machine.stuck())
    w = 50.0
    response = (plant.c @ np.linalg.solve(1j * w * np.eye(len(plant.a)) - plant.a, plant.b))[0, 0]
    by_formula = 1e7 + 1j * w * (2e4 + DAMPING) - MASS * w**2
    assert 1 / response == pytest.approx(by_formula, rel=1e-9)
