"""One suite that every exported component passes; a new one is in it by being in the list."""

import zipfile

import fmpy
import numpy as np
import pytest
import sympy as sp
from differences import partial_derivatives

from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.fmus.interface import interface_of
from ballscrew.fmus.units import base_exponents
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu_kernel
from ballscrew.solver.component import symbol
from ballscrew.solver.kernel import Model

SHOWN = (
    "plant plant_classical rotary_drive_lugre iol nctf pid_sampled relay position_encoder"
).split()
every_part = pytest.mark.parametrize(
    "name", [n if n in SHOWN else pytest.param(n, marks=pytest.mark.ci) for n in NAMES]
)


@every_part
def test_every_component_has_the_jacobian_of_its_own_right_hand_side(name):
    """Central differences in 40 digits of the symbolic equations are the oracle, in each mode."""
    part, kernel = with_law_ports(component(name)), fmu_kernel(name)
    for mode in (kernel.modes or [""]) if kernel.states else []:
        check_jacobian(part, kernel, mode)


def check_jacobian(part, kernel, mode):
    random = np.random.default_rng(1)
    model = Model(kernel)
    held = [i.name for i in kernel.inputs] + [d.name for d in kernel.discrete]
    model.u[: len(held)] = random.normal(size=len(held))
    model.u[[k for k, i in enumerate(kernel.inputs) if i.role == "internal"]] = 0
    own = {}
    if mode:
        model.u[-1] = kernel.modes.index(mode)
        own = next(m.derivatives for m in part.modes if m.name == mode)
    values = {
        symbol(p.name): sp.Float(v, 40) for p, v in zip(kernel.parameters, model.p, strict=True)
    }
    values |= {symbol(n): sp.Float(v, 40) for n, v in zip(held, model.u[: len(held)], strict=True)}
    values[symbol("t")] = sp.Float(0.25, 40)
    states = [symbol(s.name) for s in kernel.states]
    equations = zip(kernel.states, part.derivatives, strict=True)
    right = [sp.sympify(own.get(s.name, e)).xreplace(values) for s, e in equations]
    f = sp.lambdify(states, right, "mpmath")
    for _ in range(3):
        x = kernel.nominal * random.normal(size=len(states)) * 10  # near the sizes that occur
        exact = partial_derivatives(f, x, kernel.nominal)
        scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-14
        assert np.max(np.abs(model.jacobian(0.25, x) - exact) / scale) < 1e-9


@every_part
def test_description_has_what_a_tool_asks_for(fmus, name):
    description = fmpy.read_model_description(str(fmus[name]))
    simulation = description.coSimulation
    assert not simulation.needsExecutionTool
    assert simulation.canHandleVariableCommunicationStepSize
    assert simulation.canGetAndSetFMUstate
    assert simulation.canSerializeFMUstate
    assert description.defaultExperiment.stepSize == "0.001"
    kernel = fmu_kernel(name)
    starts = {v.name: v.start for v in description.modelVariables if v.start is not None}
    for v in interface_of(kernel).variables:
        base_exponents(v.unit)  # which parses it
    for p in kernel.parameters:
        assert float(starts[p.name]) == p.default  # exact, not 16 digits
    outputs = {u.variable.name: u for u in description.outputs}
    internal = {i.name for i in kernel.inputs if i.role == "internal"}
    for o in kernel.outputs:
        seen = [n for n in o.feedthrough if n not in internal]
        assert [d.name for d in outputs[o.name].dependencies] == seen
    with zipfile.ZipFile(fmus[name]) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "def rhs(t, x, u, p, dx):" in page
    assert all(p.name in page for p in kernel.parameters)


@pytest.mark.ci
@pytest.mark.parametrize("name", CONTROLLERS)
def test_controllers_have_the_same_ports_so_that_one_replaces_the_other(name):
    parts = with_law_ports(component(name))
    inputs = {i.name for i in parts.inputs if i.role != "internal"}
    forward = {"v_d", "a_d"} if name == "p_pi" else set()
    assert inputs == {"x", "v", "z", "i", "x_d"} | forward
    ports = {"u", "u_rate", *(f"u_gain_{s}" for s in "xvzi"), *(f"u_ref_{s}" for s in "xvzi")}
    assert {o.name for o in parts.all_outputs} == ports
