"""The driven mass with dry friction: slide by slide, another solver, and what is proven."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ballscrew
from ballscrew.gallery.forced_friction.findings import (
    BORDERS,
    OSCILLATOR,
    STOPPING,
    SWINGS,
    border,
    course,
    findings,
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


def another_solver(b, f, state, stop):
    """Displacement and velocity at the end, by DOP853 from turn to turn; nothing may stop."""
    t, y, largest = 0.0, np.array(state), 0.0
    while t < stop:
        side = math.copysign(1.0, y[1] or math.cos(b * t) - y[0])

        def slide(t, y, side=side):
            return [y[1], math.cos(b * t) - y[0] - f * side]

        def turns(_t, y):
            return y[1]

        turns.terminal, turns.direction = True, -side
        run = solve_ivp(slide, (t, stop), y, "DOP853", rtol=1e-12, atol=1e-13, events=turns)
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status == 1:
            y[1] = 0.0
            largest = max(largest, abs(y[0]))
    return y, largest


@pytest.mark.parametrize(("b", "f"), [*SWINGS, (0.3, 0.05), (2.5, 0.3)])
def test_the_closed_form_is_the_motion_of_another_solver(b, f):
    known = turning(b, f)
    end, largest = another_solver(b, f, known.start, 4 * math.pi / b)
    assert end == pytest.approx(known.start, abs=1e-8)
    assert largest == pytest.approx(known.swing, rel=1e-9)


frequencies = st.floats(0.36, 2.5).filter(lambda b: abs(b - 1.0) > 0.05)


@given(b=frequencies, share=st.floats(0.05, 0.98))
@settings(max_examples=25, deadline=None, derandomize=True)
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


@given(b=frequencies, share=st.floats(0.05, 0.98), start=st.floats(-2.0, 2.0))
@settings(max_examples=25, deadline=None, derandomize=True)
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


@given(b=frequencies)
@settings(max_examples=25, deadline=None, derandomize=True)
def test_slide_by_slide_the_mass_stops_above_the_border_and_not_below(b):
    assume(abs(b - 0.5) > 0.02)  # there it does not forget its start
    above = SlideBySlide(b, 1.02 * border(b)).over(60)
    assert above.stops() > 0
    known = turning(b, 0.98 * border(b))
    assume(np.abs(known.multipliers).max() ** 120 < 1e-3)
    below = SlideBySlide(b, known.f).over(60)
    assert below.stops() == 0
    assert abs(below.x) == pytest.approx(known.swing, rel=1e-2)


@pytest.mark.parametrize(("b", "f"), [*SWINGS, (0.8, 0.8)])
def test_the_multipliers_are_the_slopes_of_the_map_over_half_a_period(b, f):
    known = turning(b, f)
    half = math.pi / b

    def onward(shift):
        x, v = known.start
        end, _ = another_solver(b, f, (x + shift[0], v + shift[1]), 2 * half)
        return end

    h = 1e-5
    columns = [(onward(h * e) - onward(-h * e)) / (2 * h) for e in np.eye(2)]
    found = np.linalg.eigvals(np.column_stack(columns))
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(known.multipliers**2), abs=1e-6)


@pytest.mark.parametrize("b", BORDERS)
def test_the_second_exponent_is_lost_at_the_border(b):
    assert np.isfinite(motion(b, 0.999 * border(b), 10.0).limit).all()
    assert np.isneginf(motion(b, 1.001 * border(b), 10.0).limit).any()


@pytest.mark.parametrize(
    ("b", "f"), [*STOPPING, (0.2, 0.6), (0.15, 0.8), (0.8, 0.5), (0.8, 0.9), (1.4, 0.8)]
)
def test_it_stops_as_often_as_slide_by_slide(b, f):
    assert stops(b, f) == SlideBySlide(b, f).over(20).stops()


@pytest.mark.parametrize(("b", "f"), [*STOPPING, (0.8, 0.9), (1.4, 0.8)])
@pytest.mark.parametrize("periods", [5.0, 20.0, 20.3])
def test_a_motion_with_stops_is_a_cycle_wherever_the_run_ends(b, f, periods):
    found = motion(b, f, periods)
    assert found.kind.value == "limit cycle", found.evidence
    turns = [x for _, x in SlideBySlide(b, f).over(20).turns]
    assert found.amplitude["plant_x"] == pytest.approx(max(turns[-10:]), rel=1e-6)


@pytest.mark.parametrize(("b", "f"), [(0.3, 0.99), (1.5, 0.99), (0.05, 0.95)])
def test_with_twenty_rows_in_a_period_no_short_push_is_missed(b, f):
    exact = SlideBySlide(b, f).over(42)
    run = course({"b": b, "F": f}, 40.35, 20)
    end = float(run.time[-1])
    assert any(begin < end < over for begin, over in exact.stands)
    where = [x for t, x in exact.turns if t < end][-1]
    assert run.outputs["x"][-1] == pytest.approx(where, rel=1e-6)


def test_a_short_push_leaves_the_verdict_undecided_or_right():
    found, exact = motion(0.3, 0.99), SlideBySlide(0.3, 0.99).over(60)
    if found.kind.value != "undecided":
        assert found.amplitude["plant_x"] == pytest.approx(abs(exact.x), rel=1e-3)


@pytest.mark.parametrize("f", [0.3, 0.6, 0.7])
def test_at_resonance_the_swing_grows_by_what_friction_leaves_of_the_force(f):
    assert growth(f) == pytest.approx(math.pi - 4 * f, abs=1e-5)


@pytest.mark.parametrize("f", [0.8, 0.9])
def test_at_resonance_more_friction_than_a_quarter_of_pi_bounds_the_swing(f):
    found = motion(1.0, f, 60.0)
    assert found.kind.value == "limit cycle", found.evidence
    near = SlideBySlide(1.0 + 1e-6, f).over(60)
    assert found.amplitude["plant_x"] == pytest.approx(abs(near.x), rel=1e-4)


@pytest.mark.parametrize("aside", [0.0, 0.05, -0.1])
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


@pytest.mark.parametrize(("start", "stuck"), [(0.0, True), (0.03, True), (0.2, False)])
def test_a_force_that_friction_outweighs_moves_nothing_unless_the_spring_helps(start, stuck):
    found = ballscrew.lyapunov(
        "none",
        OSCILLATOR,
        stop=10 * 2 * math.pi / 0.6,
        plant_values={"F": 1.05, "x_start": start},
    ).motion
    assert found.kind.value == "stuck on a line of equilibria"  # sooner or later
    assert (found.equilibrium.state[0] == start) == stuck


def test_every_number_of_the_closed_form_is_met():
    assert all(f.agrees for f in findings() if f.theirs is not None)
