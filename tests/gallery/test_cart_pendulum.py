"""The balanced pendulum: Lagrange's equations, and its cycle piece by piece."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import root

import ballscrew
from ballscrew.gallery.cart_pendulum import findings as ours

GAINS = {p.name: p.default for p in ballscrew.component(ours.BALANCE).parameters}


class Exact:
    """Half a cycle of the linear loop, after which all has the other sign; it begins with a wait.

    Of the state (x, v, th, w, 1), with 1 N of Coulomb friction: the cart stands, and the rod falls,
    until the feedback pulls with 1 N; then it slides until it stands again.
    """

    def __init__(self, waiting, sliding):
        rates, force = ours.upright()
        stands = rates.copy()
        stands[0] = stands[1] = 0.0
        # while the cart stands, the rod feels no force
        stands[3] = [0.0, 0.0, ours.G / ours.ROD, 0.0]
        slides = np.zeros((5, 5))
        gains = np.array(list(GAINS.values()))
        slides[:4, :4], slides[:4, 4] = rates - np.outer(force, gains), -force
        # what breaks it away: feedback, and the pull of the rod
        pull = -gains - np.array([0.0, 0.0, ours.BOB * ours.G, 0.0])

        def start(times):
            wait, slide = expm(stands * times[0]), expm(slides * times[1])
            whole = slide[:4, :4] @ wait + np.eye(4)
            # v is 0 at the start, so its column is not asked for, and its row is what is missed
            others = [0, 2, 3]
            found = np.zeros(4)
            found[others] = np.linalg.solve(whole[np.ix_(others, others)], -slide[others, 4])
            return found, wait, slide

        def missed(times):
            state, wait, slide = start(times)
            broken = wait @ state
            end = slide[:4, :4] @ broken + slide[:4, 4]
            return [pull @ broken - 1.0, 10.0 * end[1]]

        self.times = root(missed, [waiting, sliding], tol=1e-13).x
        assert np.max(np.abs(missed(self.times))) < 1e-9
        state, wait, slide = start(self.times)
        self.period, self.swing = 2.0 * self.times.sum(), abs(state[0])
        # Disturbances of the moment it breaks away and of the moment it stands: saltation. The
        # friction does not jump when it breaks away; the rates do when it stands.
        stop = -np.array([*state, -1.0])
        before, after = slides @ stop, np.array([*(stands @ stop[:4]), 0.0])
        saltation = np.eye(4) - np.outer((before - after)[:4], [0.0, 1.0, 0.0, 0.0]) / before[1]
        half = -saltation @ slide[:4, :4] @ wait
        factors = np.sort(np.abs(np.linalg.eigvals(half)))[::-1]
        self.exponents = 2.0 * np.log(factors[:3]) / self.period


@pytest.mark.ci
def test_the_cycle_and_its_exponents_are_those_of_exact_pieces():
    exact, found = Exact(1.1, 2.45), ours.becomes(ours.DRY, 0.01)
    assert found.period == pytest.approx(exact.period, rel=1e-6)
    assert found.amplitude["plant_x"] == pytest.approx(0.01 * exact.swing, rel=1e-6)
    assert found.limit[:3] == pytest.approx(exact.exponents, abs=2e-4)
    assert found.limit[3] == -np.inf  # the velocity, where it sticks
    printed = ours.becomes(ours.DRY)  # 0.1 N, of larger angles
    assert printed.period == pytest.approx(exact.period, rel=1e-4)
    assert printed.limit[1] == pytest.approx(exact.exponents[1], rel=1e-4)
    run = ours.motion(ours.DRY, 45.0, 0.02)
    late = run.time > run.time[-1] - 3 * exact.period
    assert np.mean(run.outputs["stuck"][late]) == pytest.approx(
        2 * exact.times[0] / exact.period, abs=0.01
    )
