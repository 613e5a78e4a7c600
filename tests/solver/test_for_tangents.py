"""What tangents need: sampled, held and quantized signals as states, or as their average."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from ballscrew import Component, Delay, DiscreteState, Input, Output, Parameter, State, symbol
from ballscrew.solver.codegen import generate
from ballscrew.solver.for_tangents import dithered_average, with_held_states
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_returns, follow_tangents

PERIOD = 0.02
NUMBERS = st.floats(-2.0, 2.0, allow_nan=False, width=32)


def sampled(states: dict[str, sp.Expr], held: dict[str, sp.Expr], start: float = 0.1) -> Component:
    return Component(
        name="system",
        description="A sampled system.",
        states=tuple(State(n, "1", n, sp.sympify(e), start) for n, e in states.items()),
        discrete=tuple(DiscreteState(n, "1", n, sp.sympify(e), start) for n, e in held.items()),
        outputs=(Output("y", "1", "output", symbol(next(iter(states or held)))),),
        sample_time=Parameter("T", PERIOD, "s", "period", "test", minimum=1e-6),
    )


def model_of(component: Component, tolerance: float = 1e-11) -> Model:
    return Model(generate(with_held_states(component)), tolerance=tolerance)


def linear(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> Component:
    """x' = a x + b h between samples, h = c x + d h at them."""
    n, m = b.shape
    x = sp.Matrix([symbol(f"x{k}") for k in range(n)])
    h = sp.Matrix([symbol(f"h{k}") for k in range(m)])
    rates, updates = sp.Matrix(a) * x + sp.Matrix(b) * h, sp.Matrix(c) * x + sp.Matrix(d) * h
    return sampled({f"x{k}": rates[k] for k in range(n)}, {f"h{k}": updates[k] for k in range(m)})


@settings(max_examples=15, deadline=None)
@given(st.lists(NUMBERS, min_size=16, max_size=16))
def test_map_of_a_sampled_linear_loop_is_its_exact_monodromy(numbers: list[float]) -> None:
    a, b, c, d = np.array(numbers).reshape(4, 2, 2)
    model = model_of(linear(a, b, c, d))
    n = 4
    generator = np.zeros((n, n))
    generator[:2] = np.hstack([a, b])
    update = np.eye(n)
    update[2:] = np.hstack([c, d])
    exact = np.linalg.matrix_power(expm(generator * PERIOD) @ update, 5)
    columns = []
    for axis in np.eye(n):
        model.x[:] = 0.1
        run = follow_tangents(model, [0.0, 5 * PERIOD], 1, axis[None, :])
        columns.append(run.frame[0] * np.exp(run.growth[-1, 0]))
    size = max(1.0, np.abs(exact).max())
    np.testing.assert_allclose(np.column_stack(columns), exact, atol=1e-12 * size, rtol=0)
    np.testing.assert_allclose(model.x, exact @ np.full(n, 0.1), atol=1e-9 * size, rtol=0)


def test_what_an_update_forgets_has_minus_infinity_behind_all_that_is_finite() -> None:
    """Two commands of which one sum is remembered: the rest is gone, in any first frame."""
    a, b = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0, 0.0], [0.0, 1.0]])
    c, d = np.array([[-0.1, 0.0], [0.0, 0.0]]), np.array([[0.05, 0.15], [0.15, 0.45]])
    generator, update = np.zeros((4, 4)), np.eye(4)
    generator[:2] = np.hstack([a, b])
    update[2:] = np.hstack([c, d])
    factors = np.linalg.eigvals(expm(generator * PERIOD) @ update)
    exact = np.log(np.sort(np.abs(factors))[::-1][:3]) / PERIOD
    for order in ([0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1]):
        model = model_of(linear(a, b, c, d))
        settle = follow_tangents(model, [0.0, 40.0], frame=np.eye(4)[order])
        run = follow_tangents(model, [40.0, 41.0], frame=settle.frame)
        assert run.exponents[-1] == run.trace[-1] == -np.inf
        np.testing.assert_allclose(run.exponents[:3], exact, rtol=1e-9)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (sampled({}, {"d": 0.5 * symbol("d")}), "discrete state d"),
        (
            Component(
                "late",
                "one state with a delay",
                states=(State("x", "1", "x", -symbol("x_late"), start=1.0),),
                delays=(Delay("x_late", symbol("x"), sp.Float(1.0), start=1.0),),
            ),
            "late has the delayed signal x_late; expected it among the states, by with_delay_stat",
        ),
    ],
)
def test_what_is_held_or_late_has_to_be_among_the_states(made: Component, told: str) -> None:
    model = Model(generate(made))
    with pytest.raises(ValueError, match=told):
        follow_tangents(model, [0.0, 1.0])
    with pytest.raises(ValueError, match=told):
        follow_returns(model, 0.0, 1.0, 0, 0.0, 1)


X = symbol("x")


@pytest.mark.parametrize(
    ("steps", "mean"),
    [
        (2 * sp.floor(3 * X + sp.Rational(1, 2)) + X, lambda x: 7 * x),
        (sp.sin(X) - sp.ceiling(-X) / 4, lambda x: math.sin(x) - (0.5 - x) / 4),
    ],
)
def test_the_average_is_the_mean_over_all_places_of_the_steps(steps, mean):
    """floor(e) is e - 1/2 on average, ceiling(e) is e + 1/2."""
    plain = Component(
        "plain",
        "One equation.",
        inputs=(Input("x", "1", "input"),),
        outputs=(Output("y", "1", "output", steps),),
    )
    average = Model(generate(dithered_average(plain)))
    assert not average.kernel.quantized
    for x in (-1.3, 0.0, 0.7, 5.25):
        average.u[:] = x
        assert average.outputs(0.0, average.x)["y"] == pytest.approx(mean(x), abs=1e-12)
