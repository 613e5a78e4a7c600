"""A machine linearized, against transfer functions by hand and the running loop; its gains."""

import math

import numpy as np
import pytest
from heavy_drive import HEAVY
from scipy.optimize import minimize_scalar

from ballscrew.controllers.margins import margins_of, open_loop
from ballscrew.orchestration.loop.machine import Machine, gain_ranges, linearized, model_values
from ballscrew.orchestration.loop.parts import Part
from ballscrew.orchestration.loop.reference_motions import sine
from ballscrew.orchestration.loop.whole_loop import follow, loop_kernel
from ballscrew.plant import LAWS, plant_of
from ballscrew.solver.kernel import Model

MASS, DAMPING = 40.0, 200.0
RIGID = {"m": MASS, "sigma2": DAMPING, "Fc": 80.0, "Fs": 90.0, "Vs": 1e-3}
BRISTLES = {**RIGID, "sigma0": 1e7, "sigma1": 2e4}
KP, KI, KD = 2e4, 2e5, 400.0
GAINS = {"Kp": KP, "Ki": KI, "Kd": KD}
PERIOD = 2e-3


def law(name, values):
    return linearized(Part(name), ("x", "v"), ("u",), values, {})


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
    loop = open_loop(sliding(), law("pid_sampled", {**GAINS, "sample_time": PERIOD}), PERIOD)
    z = np.exp(1j * np.array([1.0, 10.0, 100.0, 1000.0]) * PERIOD)
    position, _ = held_plant(z)
    control = KP + KI * PERIOD * z / (z - 1) + KD * (z - 1) / (PERIOD * z)
    np.testing.assert_allclose(loop(z), position * control, rtol=1e-8)


def test_a_sampled_cascade_integrates_what_it_has_read():
    gains = {"Kx": 20.0, "Kp": 2e3, "Ki": 3e4, "u_max": 1e6, "sample_time": PERIOD}
    loop = open_loop(sliding(), law("p_pi+sampled", gains), PERIOD)
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


def heavy(**other):
    return Machine(Part("drive_lugre"), {**HEAVY, **other}, 500.0)


@pytest.mark.ci
@pytest.mark.parametrize("law", LAWS)
def test_a_command_that_slides_steadily_overcomes_friction_and_back_emf(law):
    machine = Machine(Part(plant_of(law)), {}, 36.0)
    at = machine.sliding(0.05)
    axis = 37.4e-3 * 2 * math.pi * 1000
    friction = axis * at["i"]
    back_emf = 1 / (255 * 2 * math.pi / 60) * 2 * math.pi * 1000 * 0.05
    assert at["u"] == pytest.approx(21.4 * friction / axis + back_emf, rel=1e-9)
    values = {n: p.default for n, p in machine.plant.parameters.items()}
    if law in ("lugre", "modified_lugre", "classical", "maxwell_slip"):
        assert friction == pytest.approx(values["Fc"] + values["sigma2"] * 0.05, rel=1e-5)


def test_ranges_go_with_the_inertia_and_inversely_with_the_command_s_force():
    one, _ = gain_ranges(Part("pid"), heavy(sigma2=0.0))
    other, _ = gain_ranges(Part("pid"), heavy(sigma2=0.0, m=80.0, gain=4.0))
    for name, ends in one.items():
        assert other[name] == pytest.approx([e * 2 / 4 for e in ends], rel=1e-6)
    cascade_one, _ = gain_ranges(Part("p_pi"), heavy())
    assert cascade_one["Kx"] == (0.5, 50.0)  # a bandwidth is one on every machine


def test_the_start_closes_a_stable_loop_of_twenty_per_second():
    _, start = gain_ranges(Part("pid"), heavy())
    assert start["Kp"] == pytest.approx(abs(20 * (40.0 * 20j + 200.0)), rel=1e-6)
    assert (200.0 + start["Kd"]) * start["Kp"] > 40.0 * start["Ki"]  # Routh


def test_a_controller_gets_its_machine_s_values():
    values = model_values(Part("pid_lugre"), heavy(gain=2.0))
    assert values["sigma0_hat"] == 1e7
    assert values["u_max"] == 500.0
    assert values["force_per_volt"] == 2.0
    assert not {"Kp", "Ki", "Kd", "k"} & values.keys()
    values = model_values(Part("pid_dob"), heavy())
    assert values["b"] == pytest.approx(1 / 200.0, rel=1e-6)
    assert values["lag"] == pytest.approx(0.2, rel=1e-6)


def test_a_limit_is_the_asked_one_else_that_of_the_values_else_the_nominal_amplifier_s():
    drive = Part("drive_lugre")
    assert Machine.of(drive, {"voltage_limit": 5.0}, 7.0).limit == 7.0
    assert Machine.of(drive, {"voltage_limit": 5.0}, None).limit == 5.0
    assert Machine.of(Part("plant"), {}, None).limit == 36.0
