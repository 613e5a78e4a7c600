"""The amplifier's limits: kept where set, absent where not."""

import numpy as np

from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model


def course(kernel, values, u=100.0):
    model = Model(kernel, values)
    model.set_input("u", u)
    return model.simulate(np.linspace(0, 0.05, 501))


def test_a_voltage_limit_acts_like_that_voltage():
    axis = generate(component("plant"))
    limited, asked = course(axis, {"voltage_limit": 36.0}), course(axis, {}, 36.0)
    np.testing.assert_allclose(limited.outputs["v"], asked.outputs["v"], rtol=1e-6, atol=1e-9)
    backwards = course(axis, {"voltage_limit": 36.0}, -100.0)
    np.testing.assert_allclose(backwards.outputs["v"], -limited.outputs["v"], rtol=1e-6, atol=1e-9)


def test_the_current_meets_its_limit_and_never_crosses_it():
    axis = generate(component("plant"))
    free = course(axis, {})
    assert free.outputs["i"].max() > 2.0
    limited = course(axis, {"current_limit": 0.2})
    assert limited.outputs["i"].max() <= 0.2 * (1 + 1e-6)
    assert limited.outputs["i"].max() > 0.199
