"""Generated functions against the symbolic equations they come from."""

import numpy as np
import pytest

from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.solver.kernel import Kernel, Model


def magnitudes(kernel, random):
    """A random state near the sizes that occur."""
    return np.array([s.nominal * random.normal() * 10 for s in kernel.states])


def test_a_kernel_survives_being_written_and_read():
    kernel = fmu_kernel("nctf")
    assert Kernel.from_json(kernel.to_json()) == kernel


@pytest.mark.parametrize("controller", ["iol", "nctf", "adaptive_friction", "pid_sampled"])
def test_a_connected_loop_has_the_derivatives_of_its_parts(controller):
    """Evaluate plant and controller apart, by hand, and compare with the loop's one function."""
    loop = Model(fmu_kernel(controller, "plant"))
    p, c = Model(fmu_kernel("plant")), Model(fmu_kernel(controller))
    random = np.random.default_rng(2)
    x = magnitudes(loop.kernel, random)
    by_name = dict(zip([s.name for s in loop.kernel.states], x, strict=True))
    xp = np.array([by_name["plant_" + s.name] for s in p.kernel.states])
    xc = np.array([by_name["controller_" + s.name] for s in c.kernel.states])
    references = {"x_d": 0.05, "v_d": 0.02, "a_d": -0.3}
    for i in loop.kernel.inputs:
        loop.set_input(i.name, references[i.name])
    signals = p.outputs(0.0, xp) | references
    for i in c.kernel.inputs:
        c.set_input(i.name, signals[i.name])
    for model in (c, loop):
        model.settle(0.0)
    if c.kernel.discrete:
        held = random.normal(size=len(c.kernel.discrete))
        c.u[len(c.kernel.inputs) :] = held
        loop.u[len(loop.kernel.inputs) :] = held
    p.set_input("u", c.outputs(0.0, xc)["u"])
    expected = {
        "plant_" + s.name: v for s, v in zip(p.kernel.states, p.derivatives(0.0, xp), strict=True)
    }
    expected |= {
        "controller_" + s.name: v
        for s, v in zip(c.kernel.states, c.derivatives(0.0, xc), strict=True)
    }
    computed = loop.derivatives(0.0, x)
    wanted = [expected[s.name] for s in loop.kernel.states]
    np.testing.assert_allclose(computed, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
