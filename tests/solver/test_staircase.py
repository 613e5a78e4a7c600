"""The dithered average of quantizers."""

import math

import pytest
import sympy as sp

from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Input, Output, symbol
from ballscrew.solver.for_tangents import dithered_average
from ballscrew.solver.kernel import Model

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
