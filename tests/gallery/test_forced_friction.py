"""The driven mass with dry friction: slide by slide, another solver, and what is proven."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import ballscrew
from ballscrew.gallery.forced_friction.findings import (
    BORDERS,
    OSCILLATOR,
    STOPPING,
    border,
    course,
    growth,
    motion,
    rates,
    stops,
    turning,
)


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
    known, rows = turning(b, share * border(b)), 40
    x_start, v_start = known.start
    run = course({"b": b, "F": known.f, "x_start": x_start, "v_start": v_start}, 1, rows)
    since = (run.time - known.phase / b) % (2 * math.pi / b)
    half = math.pi / b
    x, v = known.at(since % half)
    side = np.where(since < half, 1.0, -1.0)
    assert run.outputs["x"] == pytest.approx(side * x, abs=1e-6 * known.swing)
    assert run.outputs["v"] == pytest.approx(side * v, abs=1e-6 * known.swing)


@pytest.mark.ci
@given(b=frequencies, share=st.floats(0.05, 0.98), start=st.floats(-2.0, 2.0))
@settings(max_examples=10, deadline=None, derandomize=True)
def test_below_the_border_every_motion_comes_to_the_swing_of_the_closed_form(b, share, start):
    known = turning(b, share * border(b))
    slowest = np.abs(known.multipliers).max() ** 2
    periods = math.ceil(math.log(1e-8) / math.log(slowest)) if slowest < 1.0 else 10_000
    assume(periods < 150)
    found = ballscrew.lyapunov(
        "none",
        OSCILLATOR,
        stop=(periods + 10) * 2 * math.pi / b,
        plant_values={"b": b, "F": known.f, "x_start": start},
    ).motion
    assert found.kind.value == "limit cycle", found.evidence
    assert found.period == pytest.approx(2 * math.pi / b, rel=1e-5)
    assert found.amplitude["plant_x"] == pytest.approx(known.swing, rel=1e-5)
    assert found.limit.sum() == pytest.approx(rates(known).sum(), rel=1e-3)


@pytest.mark.prove
@given(b=frequencies)
@settings(max_examples=10, deadline=None, derandomize=True)
def test_slide_by_slide_the_mass_stops_above_the_border_and_not_below(b):
    assume(abs(b - 0.5) > 0.02)  # there it does not forget its start
    above = SlideBySlide(b, 1.02 * border(b)).over(60)
    assert above.stops() > 0
    known = turning(b, 0.98 * border(b))
    assume(np.abs(known.multipliers).max() ** 120 < 1e-3)
    below = SlideBySlide(b, known.f).over(60)
    assert below.stops() == 0
    assert abs(below.x) == pytest.approx(known.swing, rel=1e-2)


@pytest.mark.ci
@pytest.mark.parametrize("b", BORDERS)
def test_the_second_exponent_is_lost_at_the_border(b):
    assert np.isfinite(motion(b, 0.999 * border(b), 10.0).limit).all()
    assert np.isneginf(motion(b, 1.001 * border(b), 10.0).limit).any()


@pytest.mark.ci
@pytest.mark.parametrize(("b", "f"), STOPPING)
def test_it_stops_as_often_as_slide_by_slide(b, f):
    assert stops(b, f) == SlideBySlide(b, f).over(20).stops()


@pytest.mark.ci
@pytest.mark.parametrize(("b", "f"), [(0.8, 0.9), (1.4, 0.8)])
@pytest.mark.parametrize("periods", [5.0, 20.3])
def test_a_motion_with_stops_is_a_cycle_wherever_the_run_ends(b, f, periods):
    found = motion(b, f, periods)
    assert found.kind.value == "limit cycle", found.evidence
    turns = [x for _, x in SlideBySlide(b, f).over(20).turns]
    assert found.amplitude["plant_x"] == pytest.approx(max(turns[-10:]), rel=1e-6)


@pytest.mark.parametrize("f", [0.3, 0.7])
def test_at_resonance_the_swing_grows_by_what_friction_leaves_of_the_force(f):
    assert growth(f) == pytest.approx(math.pi - 4 * f, abs=1e-5)


@pytest.mark.ci
@pytest.mark.parametrize("aside", [0.05, -0.1])
def test_at_half_the_frequency_motions_lie_side_by_side_and_the_exponent_between_them_is_zero(
    aside,
):
    x, f = 4.0 / 3.0 + aside, 0.2
    found = motion(0.5, f, 20.0, x)
    assert found.limit[0] == pytest.approx(0.0, abs=1e-9)
    beyond = np.abs([1.0 - x, 2.0 * aside - x + 1.0])  # the spring over the force, at both turns
    ratios = (beyond - f) / (beyond + f)
    assert found.limit[1] == pytest.approx(np.log(ratios).sum() / (4 * math.pi), rel=1e-6)
    turns = [x for _, x in SlideBySlide(0.5, f, x).over(50).turns]
    assert turns == pytest.approx([aside - 4.0 / 3.0, x] * (len(turns) // 2), abs=1e-9)
    ours = course({"b": 0.5, "F": f, "x_start": x}, 50, 2).outputs["x"]
    assert ours[1:] == pytest.approx(turns[: len(ours) - 1], abs=1e-6)


@pytest.mark.ci
@pytest.mark.parametrize(("start", "stuck"), [(0.03, True), (0.2, False)])
def test_a_force_that_friction_outweighs_moves_nothing_unless_the_spring_helps(start, stuck):
    found = ballscrew.lyapunov(
        "none",
        OSCILLATOR,
        stop=10 * 2 * math.pi / 0.6,
        plant_values={"F": 1.05, "x_start": start},
    ).motion
    assert found.kind.value == "stuck on a line of equilibria"  # sooner or later
    assert (found.equilibrium.state[0] == start) == stuck
