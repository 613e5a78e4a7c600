"""The explicit pair against the stiff step, exact answers, and its own order."""

import numpy as np
import pytest
import sympy as sp
from known_systems import entries, linear, stretched, van_der_pol

from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, State, symbol
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import (
    FARTHEST,
    _followed,
    _may_be_explicit,
    _TooStiff,
    follow_tangents,
)

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once

MATRIX = [[-1.0, 4.0, 0.0], [-4.0, -2.0, 1.0], [3.0, 0.0, -9.0]]


def explicitly(model, stop, count=None):
    n = len(model.x)
    frame = np.eye(n)[: count or n]
    return _followed(model, np.array([0.0, stop]), frame, FARTHEST, explicitly=True)


def test_the_order_is_eight_on_a_nonlinear_problem():
    """With steps of a length that is given, by a tolerance that accepts them all."""
    states = (
        State("x", "1", "angle", symbol("v"), start=1.0),
        State("v", "1", "speed", -sp.sin(symbol("x"))),
    )
    kernel = generate(Component("pendulum", "a swinging one", states=states))

    def swung(count):
        model, grid = Model(kernel, {}, 1e30), np.linspace(0.0, 8.0, count + 1)
        model.info[core.NEXT_STEP] = 8.0
        return _followed(model, grid, np.eye(2)[:1], np.inf, explicitly=True).states[-1]

    counts, exact = np.array([8, 12, 16, 24]), swung(1024)
    errors = [np.abs(swung(int(count)) - exact).max() for count in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 7.5 < order < 9.0


def test_the_exponents_of_a_linear_system_are_the_exact_ones():
    run = explicitly(Model(linear(), entries(MATRIX), 1e-10), 2.0)
    np.testing.assert_allclose(run.exponents, stretched(MATRIX, 2.0), atol=1e-9)


def test_where_stiffness_limits_the_steps_nothing_is_done_and_nothing_moved():
    model = Model(van_der_pol(), {"mu": 100.0}, 1e-9)
    start, notes = model.x.copy(), model.info.copy()
    with pytest.raises(_TooStiff):
        explicitly(model, 20.0)
    assert np.array_equal(model.x, start)
    assert np.array_equal(model.info, notes)


def stiffening():
    """x' = 1, y' = -e^x (y - sin x): the longer it runs, the faster y is."""
    x, y = symbol("x"), symbol("y")
    states = (
        State("x", "1", "x", sp.Integer(1), start=0.0),
        State("y", "1", "y", -sp.exp(x) * (y - sp.sin(x)), start=1.0),
    )
    return generate(Component("stiffening", "grows stiff", states=states))


def test_a_motion_that_becomes_stiff_on_its_way_is_followed_to_its_end():
    """The determinant of its tangents is exp(1 - e^T), and y ends at sin x within 1 / e^T."""
    kernel, stop = stiffening(), 12.0
    model = Model(kernel, {}, 1e-9)
    assert _may_be_explicit(model, 0.0)
    run = follow_tangents(model, [0.0, stop])
    assert not run.failure
    assert run.growth[-1].sum() == pytest.approx(-(np.exp(stop) - 1.0), rel=1e-6)
    assert run.states[-1] == pytest.approx([stop, np.sin(stop)], abs=1e-4)
