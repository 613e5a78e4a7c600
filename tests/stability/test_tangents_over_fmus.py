"""Exponents from tangents over FMUs against those of the whole loop in one solver."""

import numpy as np
import pytest

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.stability.tangents_over_fmus import follow_over_fmus

TANGENTS = 5
GOAL = 0.08


def whole(controller, stop, **values):
    """The same tangents in one solver, their first frame in the order x, v, z, i, w."""
    kernel = loop_kernel("plant", controller)
    model = Model(kernel, values, 1e-13)
    model.set_input("x_d", GOAL)
    names = [s.name for s in kernel.states]
    order = [f"plant_{n}" for n in "xvzi"] + [n for n in names if n.startswith("controller_")]
    frame = np.eye(len(names))[[names.index(n) for n in order]]
    return follow_tangents(model, np.linspace(0.0, stop, 201), frame=frame)


@pytest.fixture
def over_fmus(fmus):
    opened = []

    def run(controller, stop, step, ports=True, **options):
        path = fmu(controller, tangents=TANGENTS) if ports else fmus[controller]
        plant = FmuInstance(fmu("plant", tangents=TANGENTS), "plant")
        other = FmuInstance(path, controller)
        opened.extend((plant, other))
        return follow_over_fmus(plant, other, GOAL, stop, step, **options)

    yield run
    for instance in opened:
        instance.close()


def worst(run, reference):
    """Largest difference as a share of what is allowed: 1e-3 relative, or 1e-3 bits/s near zero."""
    bits, expected = run.exponents / np.log(2), reference.exponents / np.log(2)
    return np.max(np.abs(bits - expected) / np.maximum(1e-3 * np.abs(expected), 1e-3))


@pytest.mark.parametrize(("controller", "stop"), [("iol", 0.5), ("nctf", 0.3)])
def test_every_exponent_is_that_of_one_solver(over_fmus, controller, stop):
    run, reference = over_fmus(controller, stop, 1e-3), whole(controller, stop)
    assert run.time[-1] == stop
    assert run.stopped == ""
    assert run.method == "tangent ports"
    assert worst(run, reference) < 1.0
    assert run.growth[-1].sum() == pytest.approx(run.trace[-1], rel=1e-4)
