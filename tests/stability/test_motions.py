"""What a motion is: its range, and cycles told from tori and from creep."""

from __future__ import annotations

from dataclasses import replace

import known_systems as ks
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew import Component, DiscreteState, Loop, Output, Parameter, State, symbol
from ballscrew.solver.codegen import generate
from ballscrew.solver.for_tangents import with_held_states
from ballscrew.solver.kernel import Kernel, Model
from ballscrew.solver.spectrum import follow_returns
from ballscrew.stability.attractor import Attractor, Kind, agree
from ballscrew.stability.classify import classify_attractor
from ballscrew.stability.lyapunov import loop_lyapunov, loop_maker

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once


def becomes(kernel: Kernel, stop: float = 100.0, **values: float) -> Attractor:
    model = Model(kernel, values, 1e-9)
    follow_returns(model, 0.0, stop, 0, np.inf, 0)
    return classify_attractor(model, stop, stop)


@pytest.mark.ci
@settings(max_examples=5, deadline=None, derandomize=True)
@given(
    passes=st.integers(1, ks.HARMONICS),
    first=st.floats(0.1, 0.5),
    decay=st.floats(-5.0, 0.0),
    turning=st.one_of(st.just(0.0), st.floats(0.0, 3.0)),
)
def test_a_cycle_with_one_to_six_passes_a_period_is_never_a_torus(
    passes: int, first: float, decay: float, turning: float
) -> None:
    """However slowly a disturbance fades, in 1 s to 28 h, and whether it turns as it fades."""
    harmonics = {"h1": first} | {f"h{passes}": 1.0}
    motion = becomes(ks.many_passes(), 50.0, **harmonics, k=10.0**decay, w=turning)
    assert motion.kind in (Kind.CYCLE, Kind.UNDECIDED), motion.evidence
    if motion.kind is Kind.CYCLE:
        assert motion.period is not None
        periods = motion.period / (2.0 * np.pi)
        assert periods == pytest.approx(round(periods), abs=1e-3)


@pytest.mark.parametrize("passes", [2, ks.HARMONICS])
def test_a_cycle_that_attracts_within_some_periods_is_found_with_its_period(passes: int) -> None:
    motion = becomes(ks.many_passes(), 50.0, **{"h1": 0.3, f"h{passes}": 1.0}, k=0.1)
    assert motion.kind is Kind.CYCLE, motion.evidence
    assert motion.return_error is not None
    assert motion.period == pytest.approx(2.0 * np.pi, rel=max(motion.return_error, 1e-8))
    np.testing.assert_allclose(motion.limit, [0.0, -0.1, -0.1, -2.0], atol=1e-3)


@pytest.mark.parametrize("ratio", [np.sqrt(2.0), 0.5 * (np.sqrt(5.0) + 1.0)])
def test_two_frequencies_without_a_common_period_are_a_torus(ratio: float) -> None:
    motion = becomes(ks.two_circles(), w=ratio)
    assert motion.kind is Kind.TORUS, motion.evidence
    np.testing.assert_allclose(motion.limit, [0.0, 0.0, -2.0, -2.0], atol=1e-9)


@pytest.mark.ci
def test_classical_friction_sticks_while_the_integral_winds_up_and_does_not_creep() -> None:
    integral = 590.0
    model = loop_maker(
        Loop("pid", "plant_classical", reference=0.05, controller_values={"Ki": integral})
    )(1e-9)
    motion = classify_attractor(model, 0.0, 20.0)
    assert motion.kind is Kind.WINDING, motion.evidence
    assert "plant_x, plant_v are constant" in motion.evidence
    # the integral's pace is the error, at which the block sticks: what it says can be computed
    position = model.x[[s.name for s in model.kernel.states].index("plant_x")]
    resistance = model.p[[p.name for p in model.kernel.parameters].index("plant_R")]
    pace = integral * (0.05 - position) / resistance
    assert f"plant_i by {pace:.3g} per second" in motion.evidence


@pytest.mark.ci
def test_what_diverges_before_the_first_hundredth_of_the_run_has_exponents_until_then() -> None:
    run, shorter = (
        loop_lyapunov(Loop("nctf+sampled", stop=stop, controller_values={"sample_time": 2e-3}))
        for stop in (20.0, 0.5)
    )
    times = shorter.running()[0]
    assert times == pytest.approx(0.5 / 400 * np.arange(1, len(times) + 1))
    assert run.motion.kind is Kind.DIVERGES
    assert len(run.running()[0]) > 100
    assert run.exponents[0] > 100.0


def test_two_tolerances_that_count_other_numbers_of_periods_agree_on_the_shorter():
    def cycle(period, amplitude):
        return Attractor(Kind.CYCLE, "", period=period, amplitude={"x": amplitude})

    assert agree(cycle(1.0, 2.0), cycle(3.0, 2.0)).period == 1.0
    assert agree(cycle(3.0, 2.0), cycle(1.0, 2.0)).period == 1.0
    assert agree(cycle(1.0, 2.0), cycle(2.0, 2.001)).kind is Kind.CYCLE
    assert agree(cycle(1.0, 2.0), cycle(2.0, 2.01)).kind is Kind.UNDECIDED  # a subharmonic
    assert agree(cycle(1.0, 2.0), cycle(1.005, 2.015)).period == 1.005
    assert agree(cycle(1.0, 2.0), cycle(1.0, 2.03)).kind is Kind.UNDECIDED
    assert agree(cycle(1.0, 2.0), cycle(1.02, 2.0)).kind is Kind.UNDECIDED
    assert agree(cycle(1.0, 2.0), cycle(1.5, 2.0)).kind is Kind.UNDECIDED


# -- its range is that of the motion, not of the ends of the steps -------------------------------


SPAN = 20.0


def ranges(model: Model, stop: float = SPAN) -> tuple[np.ndarray, np.ndarray]:
    seen = follow_returns(model, 0.0, stop, 0, np.inf, 0)
    assert not seen.failure
    return seen.low, seen.high


@settings(max_examples=20, deadline=None, derandomize=True)
@given(rate=st.floats(0.7, 5.0), x=st.floats(-2.0, 2.0), v=st.floats(0.1, 2.0))
def test_a_swing_reaches_its_amplitude_at_every_tolerance(rate: float, x: float, v: float) -> None:
    """x'' = -w^2 x from (x, v): the amplitudes are sqrt(x^2 + v^2/w^2) and w times that."""
    exact = np.hypot(x, v / rate)
    for tolerance in (1e-5, 1e-7, 1e-9):
        matrix = [[0.0, 1.0, 0.0], [-(rate**2), 0.0, 0.0], [0.0, 0.0, -1.0]]
        model = Model(ks.linear(), ks.entries(matrix), tolerance)
        model.x[:2] = x, v
        low, high = ranges(model)
        allowed = 300.0 * tolerance  # what the solver itself is off after up to sixteen turns
        np.testing.assert_allclose(high[:2], [exact, rate * exact], rtol=allowed)
        np.testing.assert_allclose(low[:2], [-exact, -rate * exact], rtol=allowed)


def test_a_ball_reaches_its_height_between_impacts() -> None:
    """From 1/2 with g = 1: parabolas of height 1/2, whose speed jumps from -1 to 1."""
    model = Model(ks.elastic_ball(), {}, 1e-9)
    model.x[:] = 0.0, 1.0
    low, high = ranges(model)
    np.testing.assert_allclose(high, [0.5, 1.0], rtol=1e-8)
    np.testing.assert_allclose(low, [0.0, -1.0], atol=1e-8)


def test_a_sampled_mass_turns_between_samples() -> None:
    """A force of -1 from the first sample on: x = 0.3 + t - t^2/2 between samples at 0.7 s."""
    x, v, h = symbol("x"), symbol("v"), symbol("h")
    mass = Component(
        name="mass",
        description="A mass under a held force.",
        states=(State("x", "m", "x", v, 0.3), State("v", "m/s", "v", h, 1.0)),
        discrete=(DiscreteState("h", "N", "h", sp.Integer(-1), 0.0),),
        outputs=(Output("y", "m", "output", x),),
        sample_time=Parameter("T", 0.7, "s", "period", "test", minimum=1e-6),
    )
    _, high = ranges(Model(generate(with_held_states(mass)), {}, 1e-9), 2.1)
    assert high[0] == pytest.approx(0.8, rel=1e-8)


def test_the_error_of_limits_is_the_larger_of_their_own_and_of_three_times_the_difference_of_two():
    first = Attractor(Kind.FIXED_POINT, "", limit=np.array([-1.0, -2.0, -np.inf]))
    own = np.array([0.1, 0.1, 0.1])
    second = replace(first, limit=np.array([-1.3, -2.05, -np.inf]), limit_error=own)
    assert agree(first, second).limit_error == pytest.approx([0.9, 0.15, 0.1])
    chaos = [replace(a, kind=Kind.CHAOS) for a in (first, second)]
    assert agree(*chaos).limit_error is own
    assert agree(first, replace(second, limit_error=None)).limit_error is None
    assert agree(first, chaos[1]).kind is Kind.UNDECIDED
