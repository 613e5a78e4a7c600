"""What holds for every controller: ranges for tuning, the limit, a start without a jump,
anti-windup."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers import CONTROLLERS, tunable
from ballscrew.fmus.catalogue import component, fmu_kernel
from ballscrew.solver.codegen import generate
from ballscrew.solver.connect import connect
from ballscrew.solver.kernel import Model

LIMITED = [n for n in CONTROLLERS if "u_max" in [p.name for p in component(n).parameters]]
INTEGRATING = [n for n in LIMITED if "Tt" in [p.name for p in component(n).parameters]]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_what_is_tunable_is_a_parameter_with_its_default_within_the_range(name):
    known = {p.name: p for p in component(name).all_parameters}
    assert tunable(name)
    for parameter, (low, high) in tunable(name).items():
        assert known[parameter].minimum <= low <= known[parameter].default <= high
        assert high <= known[parameter].maximum


@pytest.mark.parametrize("name", LIMITED)
def test_at_rest_at_the_set_point_nothing_is_commanded(name):
    model = Model(fmu_kernel(name))
    for signal in ("x", "x_d"):
        model.set_input(signal, 0.0)
    model.settle(0.0)
    assert model.outputs(0.0, model.x)["u"] == 0.0
    assert np.abs(model.derivatives(0.0, model.x)).max(initial=0.0) == 0.0


@pytest.mark.parametrize("name", LIMITED)
def test_no_command_is_larger_than_the_limit(name):
    model = Model(fmu_kernel(name), {"u_max": 24.0})
    random = np.random.default_rng(0)
    largest = 0.0
    for _ in range(200):
        for signal in model.kernel.inputs:
            model.set_input(signal.name, random.normal() * 10 ** random.uniform(-3, 1))
        model.x[:] = [random.normal() * 1000 * s.nominal for s in model.kernel.states]
        model.settle(0.0)
        u = model.outputs(0.0, model.x)["u"]
        assert abs(u) <= 24.0
        largest = max(largest, abs(u))
    assert largest == (15.0 if name == "relay" else 24.0)


@pytest.mark.parametrize("name", INTEGRATING)
def test_the_integral_comes_to_rest_while_the_limit_holds(name):
    """Far from the set-point for good: dw/dt = 0 where the command is past the limit by Tt Ki e."""
    model = Model(fmu_kernel(name), tolerance=1e-10)
    model.set_input("x_d", 1.0)
    run = model.simulate([0.0, 50.0, 100.0])
    w = run.states["w"]
    assert w[2] == pytest.approx(w[1], rel=1e-6, abs=1e-6)
    unbounded = Model(fmu_kernel(name), {"Tt": 1e9}, 1e-10)
    unbounded.set_input("x_d", 1.0)
    grown = unbounded.simulate([0.0, 50.0, 100.0]).states["w"]
    if name != "fuzzy_pd_i":  # whose integral does not fill there at all
        assert abs(grown[2]) > 1.9 * abs(grown[1]) > 100.0


@pytest.mark.parametrize("name", INTEGRATING)
def test_the_anti_windup_lets_overshoot_be_no_larger(name):
    """A step of 30 cm, which the limit of 36 V lasts for two seconds at least."""
    times = np.linspace(0.0, 8.0, 401)
    kernel = generate(connect(la.sliding(), component(name)))
    overshoot = []
    for given in ({}, {"controller_Tt": 1e9}):
        model = Model(kernel, given, 1e-7)
        model.set_input("x_d", 0.3)
        run = model.simulate(times)
        overshoot.append(run.outputs["x"].max() - 0.3)
        assert run.outputs["u"].max() == 36.0
    assert overshoot[0] <= overshoot[1] + 1e-8
