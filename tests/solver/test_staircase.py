"""The dithered average of quantizers."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Input, Output, symbol
from ballscrew.solver.for_tangents import dithered_average
from ballscrew.solver.kernel import Model

DITHER = symbol("d")


def static(value: sp.Expr) -> Model:
    component = Component(
        name="static",
        description="One equation.",
        inputs=(Input("x", "1", "input"), Input("d", "1", "dither")),
        outputs=(Output("y", "1", "output", value),),
    )
    return Model(generate(component))


@pytest.mark.parametrize(
    "steps",
    [
        lambda e: 2 * sp.floor(3 * e + sp.Rational(1, 2)) + e,
        lambda e: sp.sin(e) - sp.ceiling(-e) / 4,
    ],
)
def test_the_average_is_the_mean_over_all_places_of_the_steps(steps) -> None:
    argument = symbol("x")
    exact = static(
        steps(argument)
        .replace(sp.floor, lambda e: sp.floor(e + DITHER))
        .replace(sp.ceiling, lambda e: sp.ceiling(e + DITHER))
    )
    plain = Component(
        name="plain",
        description="One equation.",
        inputs=(Input("x", "1", "input"),),
        outputs=(Output("y", "1", "output", steps(argument)),),
    )
    average = Model(generate(dithered_average(plain)))
    assert not average.kernel.quantized
    for x in (-1.3, 0.0, 0.7, 5.25):
        dithers = (np.arange(2000) + 0.5) / 2000 - 0.5
        values = []
        for dither in dithers:
            exact.u[:] = x, dither
            values.append(exact.outputs(0.0, exact.x)["y"])
        average.u[:] = x
        assert average.outputs(0.0, average.x)["y"] == pytest.approx(np.mean(values), abs=2e-3)
