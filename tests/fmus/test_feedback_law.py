"""The feedback law's ports and the tangents' ports, both derived, against differences."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew import Component, Input, Output, Parameter, State, symbol
from ballscrew.fmus.export import export
from ballscrew.fmus.variational import variational
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.catalogue import CONTROLLERS, fmu_kernel
from ballscrew.solver.kernel import Model

FIRST = "nctf", "iol", "p_pi"
LAW = [
    n if n in FIRST else pytest.param(n, marks=pytest.mark.ci)
    for n in CONTROLLERS
    if n != "pid_sampled"
]


@pytest.mark.parametrize("name", LAW)
def test_reported_gains_and_rate_are_the_derivatives_of_the_reported_command(name):
    kernel = fmu_kernel(name)
    model = Model(kernel)
    at = {"x": 0.03, "v": 0.08, "z": 1.8e-5, "i": 0.06, "x_d": 0.08}
    at |= {"v_d": 0.0, "a_d": 0.0}
    signals = [i.name for i in kernel.inputs]
    for s in signals:
        model.set_input(s, at[s])
    model.x[:] = [0.003 for _ in model.x]
    here = model.outputs(0.0, model.x)
    for s in (s for s in signals if not s.endswith("_d")):
        assert here[f"u_ref_{s}"] == at[s]
        h = 1e-6 * at[s]
        sides = []
        for shift in (h, -h):
            model.set_input(s, at[s] + shift)
            sides.append(model.outputs(0.0, model.x)["u"])
        model.set_input(s, at[s])
        assert here[f"u_gain_{s}"] == pytest.approx(
            (sides[0] - sides[1]) / (2 * h), rel=1e-5, abs=1e-6
        )
    step = 1e-7 * model.derivatives(0.0, model.x)
    sides = [model.outputs(0.0, model.x + way * step)["u"] for way in (1, -1)]
    assert here["u_rate"] == pytest.approx((sides[0] - sides[1]) / 2e-7, rel=1e-5, abs=1e-6)


def test_an_unconnected_plant_is_an_ordinary_one_and_a_law_acts_as_stated():
    """Constant law parameters against the same linear feedback put together by hand."""
    kernel = fmu_kernel("plant")
    model = Model(kernel)
    law = {"u": 3.0, "u_gain_v": -20.0, "u_ref_v": 0.01, "u_gain_i": 4.0, "u_rate": 50.0}
    for port, value in law.items():
        model.set_input(port, value)
    names = [s.name for s in kernel.states]
    plain = Model(kernel)

    def right(t, x):
        v, i = x[names.index("v")], x[names.index("i")]
        plain.set_input("u", 3.0 - 20.0 * (v - 0.01) + 4.0 * i + 50.0 * t)
        return plain.derivatives(t, x)

    course = model.simulate(np.array([0.0, 0.005]))
    truth = solve_ivp(right, (0, 0.005), np.zeros(4), method="Radau", rtol=1e-9, atol=1e-12)
    for k, name in enumerate(names):
        assert course.states[name][-1] == pytest.approx(truth.y[k, -1], rel=1e-5)


A, B, X, V, U = map(symbol, ("a", "b", "x", "v", "u"))
PENDULUM = Component(
    name="pendulum",
    description="A damped pendulum under a torque, nonlinear, with feed-through",
    parameters=(
        Parameter("a", 3.0, "1/s^2", "stiffness", "test"),
        Parameter("b", 0.5, "1/s", "damping", "test"),
    ),
    inputs=(Input("u", "rad/s^2", "torque"),),
    states=(
        State("x", "rad", "angle", V, start=0.7),
        State("v", "rad/s", "rate", -A * sp.sin(X) - B * V + U * sp.cos(X)),
    ),
    outputs=(Output("x", "rad", "angle", X), Output("height", "1", "height", 1 - sp.cos(X) + U**2)),
)


def test_tangents_are_the_differences_of_neighbouring_motions(tmp_path):
    """With tangents of states and input, through an output of both; the trace is -b all along."""
    fmu = export(variational(PENDULUM, 2), tmp_path / "pendulum.fmu")
    moved, tangent, push = 1e-6, np.array([0.3, -1.2]), 0.8

    def end(inputs, signals, **values):
        p = FmuInstance(fmu, "pendulum")
        p.initialize({"solver_tolerance": 1e-11, **values}, 1.0)
        p.writer([*inputs])(np.array([*inputs.values()]))
        p.step(0.0, 0.5)
        found = p.reader(signals)()
        p.close()
        return found

    there, back = (
        end(
            {"u": 0.4 + share * push},
            ["x", "height"],
            x_start=0.7 + share * tangent[0],
            v_start=share * tangent[1],
        )
        for share in (moved, -moved)
    )
    signals = ["x_d1", "height_d1", "trace_integral"]
    starts = {"x_d1_start": tangent[0], "v_d1_start": tangent[1]}
    *found, trace = end({"u": 0.4, "u_d1": push}, signals, **starts)
    np.testing.assert_allclose(found, (there - back) / (2 * moved), rtol=1e-7)
    np.testing.assert_allclose(trace, -0.25, rtol=1e-9)
