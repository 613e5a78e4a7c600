"""The drive with backlash: its cycle piece by piece, its pushes, and its describing function."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import root

import ballscrew
from ballscrew.gallery.backlash_drive.findings import (
    DRIVE,
    HIGH,
    LOW,
    MOTOR_LOOP,
    TABLE_LOOP,
    B,
    D,
    K,
    M,
    after_a_push,
    begin,
    cycle,
    end,
    growth,
    linear,
    measured_push,
    motion,
    predicted,
)

LEAD = np.array([-1.0, 0.0, 1.0, 0.0, 0.0])


def pushed(gain):
    """Matrix of (x, v, xm, vm, w, 1) while the motor leads by b or more."""
    matrix = np.zeros((6, 6))
    matrix[:5, :5] = linear(gain, K)
    matrix[1, 5], matrix[3, 5] = -K * B / M, K * B / 10.0
    return matrix


def free(gain):
    matrix = np.zeros((6, 6))
    matrix[:5, :5] = linear(gain, 0.0)
    return matrix


class Exact:
    """The cycle from pieces that are linear: half a period, after which all has the other sign.

    It begins where a lead of b shrinks, so the gap is crossed first, and then the screw pulls.
    """

    def __init__(self, gain, crossing, pulling):
        mirrored = np.diag([1.0] * 5 + [-1.0]) @ pushed(gain) @ np.diag([1.0] * 5 + [-1.0])

        def start(times):
            whole = expm(mirrored * times[1]) @ expm(free(gain) * times[0])
            # after half a period: the state with the other sign
            return np.linalg.solve(whole[:5, :5] + np.eye(5), -whole[:5, 5])

        def missed(times):
            state = start(times)
            later = expm(free(gain) * times[0]) @ [*state, 1.0]
            return [LEAD @ state / B - 1.0, LEAD @ later[:5] / B + 1.0]

        self.times = root(missed, [crossing, pulling], tol=1e-12).x
        assert np.max(np.abs(missed(self.times))) < 1e-6
        state = start(self.times)
        self.period = 2.0 * self.times.sum()
        grid = np.linspace(0.0, 1.0, 2001)
        first = [expm(free(gain) * s) @ [*state, 1.0] for s in self.times[0] * grid]
        then = [expm(mirrored * s) @ first[-1] for s in self.times[1] * grid]
        self.swing = np.abs([*first, *then])[:, 0].max()
        half = -expm(linear(gain, K) * self.times[1]) @ expm(linear(gain, 0.0) * self.times[0])
        self.exponents = np.sort(2.0 * np.log(np.abs(np.linalg.eigvals(half))) / self.period)[::-1]


@pytest.mark.parametrize(
    ("gain", "crossing", "pulling"), [(HIGH, 0.005, 0.024), (LOW, 0.043, 0.025)]
)
def test_the_cycle_and_its_exponents_are_those_of_exact_pieces(gain, crossing, pulling):
    exact, found = Exact(gain, crossing, pulling), cycle(gain)
    assert found.kind.value == "limit cycle"
    assert found.period == pytest.approx(exact.period, rel=1e-6)
    assert found.amplitude["plant_x"] == pytest.approx(exact.swing, rel=1e-4)  # at ends of steps
    assert found.limit == pytest.approx(exact.exponents, rel=2e-3, abs=2e-3)


def test_what_the_describing_function_leaves_out_goes_as_its_third_harmonic():
    """The amplitude's error goes as its share, the frequency's as its square."""
    gains = (100.0, 120.0, 133.0)
    theory = [predicted(gain) for gain in gains]
    third = np.array([s.third for s in theory])
    found = [cycle(gain) for gain in gains]
    amplitude = [1 - c.amplitude["plant_x"] / s.table for c, s in zip(found, theory, strict=True)]
    frequency = [
        1 - 2 * math.pi / c.period / s.frequency for c, s in zip(found, theory, strict=True)
    ]
    assert np.all(np.abs(amplitude) < third)
    assert np.polyfit(np.log(third), np.log(amplitude), 1)[0] == pytest.approx(1.0, abs=0.15)
    assert np.polyfit(np.log(third), np.log(frequency), 1)[0] == pytest.approx(2.0, abs=0.15)


def test_more_harmonics_lead_from_the_describing_function_to_the_motion():
    """The balance of up to twenty odd harmonics, at a gain where the first is far off."""
    theory, found = predicted(LOW), cycle(LOW)
    angle = 2.0 * np.pi * (np.arange(2048) + 0.5) / 2048

    def balance(harmonics):
        orders = np.arange(1, 2 * harmonics, 2)
        waves = np.exp(1j * np.outer(orders, angle))

        def missed(given):
            frequency, parts = given[0], given[1::2] + 1j * given[2::2]
            lead = (parts[:, None] * waves).real.sum(axis=0)
            push = K / 1e6 * (lead - np.clip(lead, -1.0, 1.0))
            pushes = 2.0 * np.mean(push * waves.conj(), axis=1)
            s = 1j * orders * frequency
            table = M * s**2 + D * s
            motor = 10.0 * s**2 + 6000.0 * s + 1.5e5
            answer = 1e6 * ((1.0 + (6000.0 + 1.5e5 / s) * LOW / table) / motor + 1.0 / table)
            off = parts + answer * pushes
            return [parts[0].imag, *off.real, *off.imag]

        start = np.zeros(1 + 2 * harmonics)
        start[:2] = (theory.frequency if harmonics == 1 else previous[0]), theory.lead / B
        if harmonics > 1:
            start[: len(previous)] = previous
        return root(missed, start, tol=1e-12).x

    errors = []
    for harmonics in (1, 2, 4, 8, 12, 20):
        previous = balance(harmonics)
        errors.append(abs(previous[0] * found.period / (2 * np.pi) - 1.0))
        if harmonics == 1:
            assert previous[:2] == pytest.approx([theory.frequency, theory.lead / B], rel=1e-6)
    assert np.all(np.array(errors) < [0.32, 0.09, 1e-3, 4e-4, 1e-4, 1e-5]), errors
    assert errors[0] > 0.3


@pytest.mark.parametrize("gain", [6.3, 6.6])
def test_a_push_after_a_long_wait_is_that_of_its_matrix_exponential(gain):
    assert measured_push(gain) == pytest.approx(after_a_push(gain), rel=1e-5)


@pytest.mark.parametrize(("share", "kind"), [(0.9, False), (1.15, True)])
def test_cycles_begin_where_a_push_moves_the_table_as_far_beyond(share, kind):
    x = motion(TABLE_LOOP, share * begin(), 20.0, 4e-3).outputs["x"]
    assert bool(np.abs(x[-2500:]).max() > 2e-6) == kind


def test_without_backlash_the_drive_is_stable_up_to_the_end_of_the_cycles():
    assert np.linalg.eigvals(linear(0.99 * end(), K)).real.max() < 0.0
    assert growth(1.01 * end(), K).real > 0.0
    found = ballscrew.lyapunov(
        TABLE_LOOP,
        DRIVE,
        stop=2.0,
        reference=0.0,
        plant_values={"b": 0.0},
        controller_values={"Kx": HIGH},
    ).motion
    assert found.kind.value == "isolated fixed point"
    slowest = np.linalg.eigvals(linear(HIGH, K)).real.max()
    assert found.limit[0] == pytest.approx(slowest, rel=1e-6)


def test_the_amplitude_is_a_multiple_of_the_backlash_and_the_frequency_does_not_depend_on_it():
    wide = ballscrew.lyapunov(
        TABLE_LOOP,
        DRIVE,
        stop=2.0,
        reference=0.0,
        plant_values={"b": 5 * B},
        controller_values={"Kx": HIGH},
    ).motion
    assert wide.period == pytest.approx(cycle(HIGH).period, rel=1e-6)
    assert wide.amplitude["plant_x"] == pytest.approx(
        5 * cycle(HIGH).amplitude["plant_x"], rel=1e-5
    )


def test_measured_at_the_motor_it_rests_within_the_backlash():
    run = motion(MOTOR_LOOP, 60.0, 8.0, 1e-2).outputs
    assert abs(run["xm"][-1]) < 1e-12
    assert 1e-7 < abs(run["x"][-1]) < B
    assert abs(run["v"][-1]) < 1e-12


def test_dry_friction_at_the_table_ends_the_hunting_as_another_solver_has_it():
    dry = DRIVE.replace(":drive", ":dry_drive")
    found = ballscrew.lyapunov(TABLE_LOOP, dry, stop=2.0, reference=0.0)
    assert found.motion.kind.value == "stuck on a line of equilibria"

    def rates(_t, y, dry):
        x, v, xm, vm, w = y
        lead = xm - x
        push = K * (lead - min(max(lead, -B), B))
        error = -60.0 * x - vm
        motor = 6000.0 * error + w - push
        return [v, (push - D * v - dry * math.tanh(v / 1e-7)) / M, vm, motor / 10.0, 1.5e5 * error]

    def swing(dry):
        y = [2e-5, 0.0, 2e-5, 0.0, 0.0]
        run = solve_ivp(rates, (0.0, 1.0), y, "LSODA", rtol=1e-8, atol=1e-12, args=(dry,))
        return np.abs(run.y[0, run.t > 0.8]).max()

    assert swing(1.0) < 1e-6 < 2e-5 < swing(0.0)
