"""The impact oscillator: a map from impact to impact, another solver, and its closed form."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from ballscrew.gallery.finding import motion as run_of
from ballscrew.gallery.impact_oscillator import findings as ours


def complex_swing(t, force, zeta, omega):
    """Displacement and velocity of the motion without impacts, by its complex amplitude."""
    turning = force / (1 - omega**2 + 2j * zeta * omega) * np.exp(1j * omega * np.asarray(t))
    return turning.real, (1j * omega * turning).real


def free_flight(s, zeta):
    """Matrix that takes a free motion on by a time s."""
    w = math.sqrt(1 - zeta**2)
    c, d = math.cos(w * s), math.sin(w * s) / w
    return math.exp(-zeta * s) * np.array([[c + zeta * d, d], [-d, c - zeta * d]])


class FromImpactToImpact:
    """A motion from rest at x = 0 and its first tangent, by exact flights and saltation."""

    def __init__(self, force):
        self.force, self.t, self.state = force, 0.0, np.zeros(2)
        self.tangent, self.growth = np.array([1.0, 0.0]), 0.0

    def fly(self, s):
        flight = free_flight(s, ours.ZETA)
        forced = np.array(complex_swing(self.t, self.force, ours.ZETA, ours.OMEGA))
        self.state = flight @ (self.state - forced)
        self.t += s
        self.state = self.state + complex_swing(self.t, self.force, ours.ZETA, ours.OMEGA)
        self.stretch(flight)

    def stretch(self, matrix):
        self.tangent = matrix @ self.tangent
        size = np.linalg.norm(self.tangent)
        self.growth += math.log(size)
        self.tangent /= size

    def until_the_impact(self):
        begin = self.state - complex_swing(self.t, self.force, ours.ZETA, ours.OMEGA)

        def beyond(s):
            forced, _ = complex_swing(self.t + s, self.force, ours.ZETA, ours.OMEGA)
            return (free_flight(s, ours.ZETA) @ begin)[0] + forced - ours.GAP

        s = 0.02
        while beyond(s) <= 0.0:
            s += 0.02
        return brentq(beyond, s - 0.02 if s > 0.03 else 1e-9, s, xtol=1e-14)

    def strike(self):
        v = self.state[1]
        pull = self.force * math.cos(ours.OMEGA * self.t) - ours.GAP
        # rates of the velocity after and before the impact
        kick = (pull + 2 * ours.ZETA * ours.R * v) + ours.R * (pull - 2 * ours.ZETA * v)
        self.stretch(np.array([[-ours.R, 0.0], [kick / v, -ours.R]]))
        self.state = np.array([ours.GAP, -ours.R * v])


def test_the_exponent_over_a_while_is_that_of_the_map_from_impact_to_impact():
    motion, end = FromImpactToImpact(ours.CHAOTIC * ours.GRAZING), ours.SHORT * ours.PERIOD
    while motion.t + (s := motion.until_the_impact()) < end:
        motion.fly(s)
        motion.strike()
    motion.fly(end - motion.t)
    assert ours.exponents(ours.CHAOTIC, ours.SHORT).exponents[0] == pytest.approx(
        motion.growth / end, abs=1e-6
    )


@given(
    zeta=st.floats(0.0, 0.3),
    omega=st.floats(1.2, 4.0),
    gap=st.floats(-0.5, 1.0),
    r=st.floats(0.2, 0.9),
    force=st.floats(0.5, 20.0),
)
@settings(max_examples=12, deadline=None, derandomize=True)
def test_a_motion_with_one_impact_in_each_period_is_that_of_the_closed_form(
    zeta, omega, gap, r, force
):
    """Stable or not: from its start it comes back after a period, if nothing is hit in between."""
    try:
        known = ours.single_impact(force, zeta, omega, gap, r)
    except ValueError:
        assume(False)
    assume(known.speed > 0.05 and np.abs(known.multipliers).max() < 50.0)
    hit = known.phase / omega
    p, q = complex_swing(hit, force, zeta, omega)
    begin = np.array([gap - p, -r * known.speed - q])
    inside = np.linspace(0.0, 2 * np.pi / omega, 400)[1:-1]
    course = [(free_flight(s, zeta) @ begin)[0] for s in inside]
    assume(np.all(course + complex_swing(hit + inside, force, zeta, omega)[0] < gap))
    values = {"zeta": zeta, "omega": omega, "gap": gap, "r": r, "force": force}
    values |= {"x_start": known.start[0], "v_start": known.start[1]}
    run = run_of(ours.OSCILLATOR, 2 * np.pi / omega, 2 * np.pi / omega, values)
    assert run.outputs["x"][-1] == pytest.approx(known.start[0], abs=1e-7 * force)
    assert run.outputs["v"][-1] == pytest.approx(known.start[1], abs=1e-7 * force)


@pytest.mark.ci
def test_where_impacts_chatter_no_disturbance_outlives_them():
    found = ours.exponents(1.2)
    assert np.all(np.isneginf(found.exponents))
    assert np.all(np.isneginf(found.motion.limit))
    run = ours.motion({"force": 1.2 * ours.GRAZING}, 60, 100).outputs
    assert np.any((run["x"] == ours.GAP) & (run["v"] == 0.0))  # it stays at the stop for a while
