"""FMUs with tangents against differences of the same FMU's own motion."""

import numpy as np
import pytest
import sympy as sp

from ballscrew.fmus.export import export
from ballscrew.fmus.variational import variational
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.component import Component, Input, Output, Parameter, State, symbol
from ballscrew.solver.errors import ContractError

A, B, X, V, U = map(symbol, ("a", "b", "x", "v", "u"))


def pendulum():
    """Nonlinear, with an output of its own and feed-through."""
    return Component(
        name="pendulum",
        description="A damped pendulum under a torque",
        parameters=(
            Parameter("a", 3.0, "1/s^2", "stiffness", "test"),
            Parameter("b", 0.5, "1/s", "damping", "test"),
        ),
        inputs=(Input("u", "rad/s^2", "torque"),),
        states=(
            State("x", "rad", "angle", V, start=0.7),
            State("v", "rad/s", "rate", -A * sp.sin(X) - B * V + U * sp.cos(X)),
        ),
        outputs=(
            Output("x", "rad", "angle", X),
            Output("height", "1", "height", 1 - sp.cos(X) + U**2),
        ),
    )


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    return export(variational(pendulum(), 2), tmp_path_factory.mktemp("v") / "pendulum.fmu")


@pytest.fixture
def opened(fmu):
    kept = []

    def make(**values):
        instance = FmuInstance(fmu, "pendulum")
        kept.append(instance)
        instance.initialize({"solver_tolerance": 1e-11, **values}, 1.0)
        return instance

    yield make
    for instance in kept:
        instance.close()


def test_tangents_are_the_differences_of_neighbouring_motions(opened):
    """With tangents of the states and of the input, and through an output that follows both."""
    moved = 1e-6
    tangent, push = np.array([0.3, -1.2]), 0.8

    def end(share):
        p = opened(x_start=0.7 + share * tangent[0], v_start=share * tangent[1])
        p.writer(["u"])(np.array([0.4 + share * push]))
        p.step(0.0, 0.5)
        return p.reader(["x", "height"])()

    p = opened(x_d1_start=tangent[0], v_d1_start=tangent[1])
    p.writer(["u", "u_d1"])(np.array([0.4, push]))
    p.step(0.0, 0.5)
    expected = (end(moved) - end(-moved)) / (2 * moved)
    np.testing.assert_allclose(p.reader(["x_d1", "height_d1"])(), expected, rtol=1e-7)


def test_without_start_values_the_tangents_are_the_transition_matrix(opened):
    """Liouville: its determinant is the exponential of the trace's integral, -b t here."""
    p = opened()
    p.step(0.0, 0.5)
    (a, b, c, d), trace = (
        p.reader(["x_d1", "x_d2", "v_d1", "v_d2"])(),
        p.reader(["trace_integral"])(),
    )
    assert trace[0] == pytest.approx(-0.25, rel=1e-9)
    assert np.log(a * d - b * c) == pytest.approx(-0.25, rel=1e-8)


@pytest.mark.parametrize(
    ("name", "what"), [("plant_classical", "modes"), ("pid_sampled", "discrete")]
)
def test_what_cannot_have_tangents_is_refused_with_the_reason(name, what):
    with pytest.raises(ContractError, match=what):
        variational(component(name), 2)
