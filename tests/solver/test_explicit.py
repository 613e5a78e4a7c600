"""The explicit pair against the stiff step, exact answers, and its own order."""

import itertools

import numpy as np
import pytest
import sympy as sp
from known_systems import belt, entries, linear, lorenz, stretched, torus, van_der_pol

from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver import core
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, State, symbol
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import FARTHEST, _may_be_explicit, _stride, _walk, follow_tangents

pytestmark = pytest.mark.xdist_group("known_systems")  # each system is compiled once

MATRIX = [[-1.0, 4.0, 0.0], [-4.0, -2.0, 1.0], [3.0, 0.0, -9.0]]


def explicitly(model, stop, count=None):
    n = len(model.x)
    return _stride(model, np.array([0.0, stop]), np.eye(n)[: count or n], FARTHEST)


def stiffly(model, stop):
    return _walk(model, np.array([0.0, stop]), np.eye(len(model.x)), FARTHEST, collocating=False)


def test_the_order_is_eight_on_a_nonlinear_problem():
    """With steps of a length that is given, by a tolerance that accepts them all."""
    kernel = generate(
        Component(
            "pendulum",
            "a swinging one",
            states=(
                State("x", "1", "angle", symbol("v")),
                State("v", "1", "speed", -sp.sin(symbol("x"))),
            ),
        )
    )
    errors = []
    exact = swung(kernel, 1024)
    counts = np.array([8, 12, 16, 24])
    for count in counts:
        errors.append(np.abs(swung(kernel, int(count)) - exact).max())
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 7.5 < order < 9.0


def swung(kernel, count):
    """The state after 8 s in so many steps."""
    model = Model(kernel, {"x_start": 1.0}, 1e30)
    grid = np.linspace(0.0, 8.0, count + 1)
    states = np.empty((len(grid), 2))
    states[0] = model.x
    bound, scale, frame = np.full(2, np.inf), np.ones(2), np.eye(2)[:1].copy()
    growth, trace = np.zeros((len(grid), 1)), np.zeros(len(grid))
    walk = core.Walk(
        len(grid),
        1,
        *(core.at(a) for a in (grid, states, growth, trace, frame, model.u, model.p, model.atol)),
        1e30,
        core.at(bound),
        core.at(scale),
        10,
        False,
    )
    model.info[core.NEXT_STEP] = 8.0
    assert model.system.spectrum(walk, True, model.info) == len(grid)
    return states[-1].copy()


@pytest.mark.parametrize(
    ("kernel", "values", "stop"), [(lorenz, {}, 5.0), (van_der_pol, {"mu": 5.0}, 20.0)]
)
def test_the_exponents_are_those_of_the_stiff_step(kernel, values, stop):
    ours = explicitly(Model(kernel(), values, 1e-10), stop)
    theirs = stiffly(Model(kernel(), values, 1e-13), stop)
    np.testing.assert_allclose(ours.exponents, theirs.exponents, atol=2e-8)
    np.testing.assert_allclose(ours.states, theirs.states, atol=2e-8)
    np.testing.assert_allclose(ours.trace, theirs.trace, atol=2e-8)
    assert ours.growth[-1].sum() == pytest.approx(ours.trace[-1], rel=1e-9)


def test_the_exponents_of_a_linear_system_are_the_exact_ones():
    run = explicitly(Model(linear(), entries(MATRIX), 1e-10), 2.0)
    np.testing.assert_allclose(run.exponents, stretched(MATRIX, 2.0), atol=1e-9)


def test_what_a_tenth_of_the_tolerance_changes_bounds_the_error():
    """Steps go with the tolerance to the power 1/8, the error with the steps' seventh or eighth."""
    exact = stiffly(Model(van_der_pol(), {}, 1e-13), 20.0).exponents
    tolerances = 10.0 ** -np.arange(5.0, 11.0)
    runs = [explicitly(Model(van_der_pol(), {}, t), 20.0).exponents for t in tolerances]
    errors = [float(np.max(np.abs(r - exact))) for r in runs]
    changes = [float(np.max(np.abs(a - b))) for a, b in itertools.pairwise(runs)]
    order = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.7 < order < 1.2, errors
    for error, change in zip(errors, changes, strict=False):
        assert error < 2.0 * change, (errors, changes)


def test_a_motion_that_runs_away_ends_with_the_state_that_does():
    model = Model(van_der_pol(), {"mu": -1.0, "x_start": 3.0}, 1e-9)
    assert _may_be_explicit(model, 0.0)
    run = follow_tangents(model, np.linspace(0.0, 50.0, 11))
    assert run.diverged
    assert "diverges" in run.failure
    assert run.time[-1] < 50.0
    assert len(run.growth) == len(run.time) == len(run.states)


@pytest.mark.ci
def test_only_what_is_smooth_and_not_stiff_is_left_to_the_explicit_pair():
    def chosen(kernel, values=None):
        return _may_be_explicit(Model(kernel, values, 1e-9), 0.0)

    assert chosen(lorenz())
    assert chosen(van_der_pol())
    assert chosen(torus())
    assert not chosen(van_der_pol(), {"mu": 1000.0})
    assert not chosen(linear(), entries(MATRIX))  # exponentials are exact there
    assert not chosen(belt())
    assert not chosen(loop_kernel("plant", "nctf"))
    assert not chosen(loop_kernel("plant", "iol"))


def test_where_stiffness_limits_the_steps_nothing_is_done_and_nothing_moved():
    model = Model(van_der_pol(), {"mu": 100.0}, 1e-9)
    start, notes = model.x.copy(), model.info.copy()
    assert explicitly(model, 20.0) is None
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
