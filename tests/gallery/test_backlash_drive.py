"""The drive with backlash: its cycle piece by piece, its pushes, and its describing function."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import root

import ballscrew
from ballscrew.gallery.backlash_drive.findings import (
    DRIVE,
    HIGH,
    LOW,
    TABLE_LOOP,
    B,
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


@pytest.mark.ci
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


@pytest.mark.parametrize("gain", [6.3, 6.6])
def test_a_push_after_a_long_wait_is_that_of_its_matrix_exponential(gain):
    assert measured_push(gain) == pytest.approx(after_a_push(gain), rel=1e-5)


@pytest.mark.ci
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
