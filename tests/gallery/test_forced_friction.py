"""The driven mass with dry friction: slide by slide, and its closed form."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from ballscrew.gallery.forced_friction import findings as ours


class SlideBySlide:
    """The motion from a turn on, each slide by its linear equation, in units of mass and spring."""

    def __init__(self, b, f, x=0.0, t=0.0):
        self.b, self.f, self.x, self.t = b, f, x, t
        self.stands, self.turns = [], []

    def stand(self):
        """Until the force moves the mass: how long."""
        begin = self.t

        def beyond(t):
            return abs(math.cos(self.b * t) - self.x) - self.f

        if beyond(begin) <= 0.0:
            grid = begin + np.linspace(0.0, 2 * math.pi / self.b, 4001)
            first = np.flatnonzero(np.abs(np.cos(self.b * grid) - self.x) > self.f)[0]
            self.t = brentq(beyond, grid[first - 1], grid[first], xtol=1e-14)
            self.stands.append((begin, self.t))

    def slide(self):
        """Until the next turn."""
        b, t = self.b, self.t
        side = math.copysign(1.0, math.cos(b * (t + 1e-7)) - self.x)
        swing = 1.0 / (1.0 - b**2)
        p = self.x - swing * math.cos(b * t) + self.f * side
        q = b * swing * math.sin(b * t)

        def ahead(s):
            return side * (q * np.cos(s) - p * np.sin(s) - b * swing * np.sin(b * (t + s)))

        grid = np.linspace(0.0, 20.0 / min(b, 1.0), 20001)[1:]
        k = np.flatnonzero(ahead(grid) < 0.0)[0]
        end = brentq(ahead, grid[k - 1], grid[k], xtol=1e-14) if k else 0.5 * grid[0]
        forced = swing * math.cos(b * (t + end)) - self.f * side
        self.x = p * math.cos(end) + q * math.sin(end) + forced
        self.t += end
        self.turns.append((self.t, self.x))

    def over(self, periods):
        end = self.t + periods * 2 * math.pi / self.b
        while self.t < end:
            self.stand()
            self.slide()
        return self

    def stops(self):
        """In a period, over the last five."""
        since = self.t - 10 * math.pi / self.b
        return sum(end > since for _, end in self.stands) / 5


frequencies = st.floats(0.36, 2.5).filter(lambda b: abs(b - 1.0) > 0.05)


@given(b=frequencies, share=st.floats(0.05, 0.98))
@settings(max_examples=10, deadline=None, derandomize=True)
def test_below_the_border_the_motion_of_the_closed_form_comes_back_at_every_instant(b, share):
    known, rows = ours.turning(b, share * ours.border(b)), 40
    x_start, v_start = known.start
    run = ours.course({"b": b, "F": known.f, "x_start": x_start, "v_start": v_start}, 1, rows)
    since = (run.time - known.phase / b) % (2 * math.pi / b)
    half = math.pi / b
    x, v = known.at(since % half)
    side = np.where(since < half, 1.0, -1.0)
    assert run.outputs["x"] == pytest.approx(side * x, abs=1e-6 * known.swing)
    assert run.outputs["v"] == pytest.approx(side * v, abs=1e-6 * known.swing)


@pytest.mark.ci
@pytest.mark.parametrize(("b", "f"), ours.STOPPING)
def test_it_stops_as_often_as_slide_by_slide(b, f):
    assert ours.stops(b, f) == SlideBySlide(b, f).over(20).stops()


@pytest.mark.ci
@pytest.mark.parametrize(("b", "f"), [(0.8, 0.9), (1.4, 0.8)])
@pytest.mark.parametrize("periods", [5.0, 20.3])
def test_a_motion_with_stops_is_a_cycle_wherever_the_run_ends(b, f, periods):
    found = ours.motion(b, f, periods)
    assert found.kind.value == "limit cycle", found.evidence
    turns = [x for _, x in SlideBySlide(b, f).over(20).turns]
    assert found.amplitude["plant_x"] == pytest.approx(max(turns[-10:]), rel=1e-6)


@pytest.mark.parametrize("start", [0.0, 0.04])
def test_a_mass_that_its_force_never_moves_is_stuck_where_it_was(start):
    found = ours.motion(0.3, 1.05, 20.0, start)
    assert found.kind.value == "stuck on a line of equilibria", found.evidence
    assert found.equilibrium.state[0] == start
