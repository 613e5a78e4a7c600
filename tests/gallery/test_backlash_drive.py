"""The drive with backlash: its cycle, piece by piece, and where it is stable without backlash."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import root

from ballscrew.gallery.backlash_drive import findings as ours
from ballscrew.gallery.finding import exponents

LEAD = np.array([-1.0, 0.0, 1.0, 0.0, 0.0])


def pushed(gain):
    """Matrix of (x, v, xm, vm, w, 1) while the motor leads by b or more."""
    matrix = np.zeros((6, 6))
    matrix[:5, :5] = ours.linear(gain, ours.K)
    matrix[1, 5], matrix[3, 5] = -ours.K * ours.B / ours.M, ours.K * ours.B / 10.0
    return matrix


def free(gain):
    matrix = np.zeros((6, 6))
    matrix[:5, :5] = ours.linear(gain, 0.0)
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
            return [LEAD @ state / ours.B - 1.0, LEAD @ later[:5] / ours.B + 1.0]

        self.times = root(missed, [crossing, pulling], tol=1e-12).x
        assert np.max(np.abs(missed(self.times))) < 1e-6
        state = start(self.times)
        self.period = 2.0 * self.times.sum()
        grid = np.linspace(0.0, 1.0, 2001)
        first = [expm(free(gain) * s) @ [*state, 1.0] for s in self.times[0] * grid]
        then = [expm(mirrored * s) @ first[-1] for s in self.times[1] * grid]
        self.swing = np.abs([*first, *then])[:, 0].max()
        half = -expm(ours.linear(gain, ours.K) * self.times[1]) @ expm(
            ours.linear(gain, 0.0) * self.times[0]
        )
        self.exponents = np.sort(2.0 * np.log(np.abs(np.linalg.eigvals(half))) / self.period)[::-1]


@pytest.mark.parametrize(
    ("gain", "crossing", "pulling"), [(ours.HIGH, 0.005, 0.024), (ours.LOW, 0.043, 0.025)]
)
def test_the_cycle_and_its_exponents_are_those_of_exact_pieces(gain, crossing, pulling):
    exact, found = Exact(gain, crossing, pulling), ours.cycle(gain)
    assert found.kind.value == "limit cycle"
    assert found.period == pytest.approx(exact.period, rel=1e-6)
    assert found.amplitude["plant_x"] == pytest.approx(exact.swing, rel=1e-4)  # at ends of steps
    assert found.limit == pytest.approx(exact.exponents, rel=2e-3, abs=2e-3)


def test_without_backlash_the_drive_is_stable_up_to_the_end_of_the_cycles():
    assert np.linalg.eigvals(ours.linear(0.99 * ours.end(), ours.K)).real.max() < 0.0
    assert ours.growth(1.01 * ours.end(), ours.K).real > 0.0
    found = exponents(ours.DRIVE, 2.0, {"b": 0.0}, ours.TABLE_LOOP, 0.0, {"Kx": ours.HIGH}).motion
    assert found.kind.value == "isolated fixed point"
    slowest = np.linalg.eigvals(ours.linear(ours.HIGH, ours.K)).real.max()
    assert found.limit[0] == pytest.approx(slowest, rel=1e-6)
