"""The feedback law's ports, derived on both sides, and the law in a master that knows nothing."""

import numpy as np
import pytest
from any_fmu import Host
from scipy.integrate import solve_ivp

from ballscrew.orchestration.loop.catalogue import CONTROLLERS, fmu_kernel
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.reference_signal import Reference
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
    rate = (sides[0] - sides[1]) / 2e-7
    assert here["u_rate"] == pytest.approx(rate, rel=1e-5, abs=1e-6)


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


def plain_jacobi(made, h, stop):
    """Positions by a tool that can only connect equal names, and exchanges after each step."""
    plant = Host(made("plant", "native-2"))
    controller = Host(made("iol", "native-2"), {"x_d": 0.08})
    commands = ["u", "u_rate", *(f"u_{part}_{s}" for part in ("gain", "ref") for s in "xvzi")]
    controller.set(dict(zip("xvzi", plant.get(*"xvzi"), strict=True)))
    law = controller.get(*commands)
    course = [0.0]
    for k in range(round(stop / h)):
        plant.set(dict(zip(commands, law, strict=True)))
        plant.step(k * h, h)
        controller.step(k * h, h)
        law, measured = controller.get(*commands), plant.get(*"xvzi")
        controller.set(dict(zip("xvzi", measured, strict=True)))
        course.append(measured[0])
    plant.close()
    controller.close()
    return np.array(course)


@pytest.mark.ci
def test_the_law_through_a_plain_jacobi_master_is_of_second_order(made):
    """4.2e-4 m at 1e-3 s and 1.8e-5 m at 2e-4 s for the linearizing controller, no rollback."""
    truth = run_monolithic(Loop("iol", reference=Reference.constant(0.08), stop=1.0), 1e-4)
    steps = np.array([1e-3, 5e-4, 2e-4])
    errors = []
    for h in steps:
        x = plain_jacobi(made, h, 1.0)
        errors.append(np.abs(x - truth.outputs["x"][:: round(h / 1e-4)]).max())
    assert errors[0] == pytest.approx(4.2e-4, rel=0.1)
    assert errors[2] == pytest.approx(1.8e-5, rel=0.1)
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15)
