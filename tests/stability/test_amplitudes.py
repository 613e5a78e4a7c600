"""The range of a motion is that of the motion, not of the ends of the solver's steps."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_systems import elastic_ball, entries, linear

from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, DiscreteState, Output, Parameter, State, symbol
from ballscrew.solver.for_tangents import with_held_states
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_returns

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once

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
        model = Model(linear(), entries(matrix), tolerance)
        model.x[:2] = x, v
        low, high = ranges(model)
        allowed = 300.0 * tolerance  # what the solver itself is off after up to sixteen turns
        np.testing.assert_allclose(high[:2], [exact, rate * exact], rtol=allowed)
        np.testing.assert_allclose(low[:2], [-exact, -rate * exact], rtol=allowed)


def test_a_ball_reaches_its_height_between_impacts() -> None:
    """From 1/2 with g = 1: parabolas of height 1/2, whose speed jumps from -1 to 1."""
    model = Model(elastic_ball(), {}, 1e-9)
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
    model = Model(generate(with_held_states(mass)), {}, 1e-9)
    _, high = ranges(model, 2.1)
    assert high[0] == pytest.approx(0.8, rel=1e-8)
