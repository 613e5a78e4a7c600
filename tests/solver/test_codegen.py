"""Generated functions against the symbolic equations they come from."""

import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import sympy as sp

from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus.catalogue import NAMES, component, fmu_kernel
from ballscrew.fmus.export import with_law_ports
from ballscrew.solver.component import symbol
from ballscrew.solver.connect import connect
from ballscrew.solver.kernel import Kernel, Model


def magnitudes(kernel, random):
    """A random state near the sizes that occur."""
    return np.array([s.nominal * random.normal() * 10 for s in kernel.states])


@pytest.mark.parametrize("name", [n for n in NAMES if fmu_kernel(n).states])
def test_every_component_has_the_jacobian_of_its_own_right_hand_side(name):
    """Central differences in 40 digits of the symbolic equations are the oracle."""
    part = with_law_ports(component(name))
    kernel = fmu_kernel(name)
    random = np.random.default_rng(1)
    model = Model(kernel)
    model.u[:] = random.normal(size=len(model.u))
    model.u[[i.role == "internal" for i in kernel.inputs] + [False] * len(kernel.discrete)] = 0
    values = {
        symbol(p.name): sp.Float(v, 40) for p, v in zip(kernel.parameters, model.p, strict=True)
    }
    held = [i.name for i in kernel.inputs] + [d.name for d in kernel.discrete]
    values |= {symbol(n): sp.Float(v, 40) for n, v in zip(held, model.u, strict=True)}
    values[symbol("t")] = sp.Float(0.25, 40)
    states = [symbol(s.name) for s in kernel.states]
    right = [e.xreplace(values) for e in part.derivatives]
    f = sp.lambdify(states, right, "mpmath")
    import mpmath

    with mpmath.workdps(40):
        for _ in range(3):
            x = magnitudes(kernel, random)
            exact = np.zeros((len(x), len(x)))
            for j, s in enumerate(kernel.states):
                h = mpmath.mpf(s.nominal) * mpmath.mpf(10) ** -16
                up = [mpmath.mpf(v) for v in x]
                down = list(up)
                up[j], down[j] = up[j] + h, down[j] - h
                difference = zip(f(*up), f(*down), strict=True)
                exact[:, j] = [float((a - b) / (2 * h)) for a, b in difference]
            computed = model.jacobian(0.25, x)
            scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-30
            assert np.max(np.abs(computed - exact) / scale) < 1e-9


def test_a_kernel_survives_being_written_and_read():
    kernel = fmu_kernel("nctf")
    assert Kernel.from_json(kernel.to_json()) == kernel


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_connected_loop_has_the_derivatives_of_its_parts(controller):
    """Evaluate plant and controller apart, by hand, and compare with the loop's one function."""
    from ballscrew.solver.codegen import generate

    plant, ours = component("plant"), component(controller)
    loop = Model(generate(connect(plant, ours)))
    p, c = Model(generate(plant)), Model(generate(ours))
    random = np.random.default_rng(2)
    x = magnitudes(loop.kernel, random)
    by_name = dict(zip([s.name for s in loop.kernel.states], x, strict=True))
    xp = np.array([by_name["plant_" + s.name] for s in p.kernel.states])
    xc = np.array([by_name["controller_" + s.name] for s in c.kernel.states])
    loop.set_input("x_d", 0.05)
    signals = p.outputs(0.0, xp) | {"x_d": 0.05}
    for i in c.kernel.inputs:
        c.set_input(i.name, signals[i.name])
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


def test_two_kernels_cached_by_different_processes_do_not_run_each_other(tmp_path):
    """numba links cached code by name; two systems once met under one name and mixed."""
    run = textwrap.dedent(
        """
        import sys
        import numpy as np
        from ballscrew.fmus.catalogue import fmu_kernel
        from ballscrew.solver.kernel import Model
        for name in sys.argv[1:]:
            model = Model(fmu_kernel(name))
            model.u[:] = 0.01
            course = model.simulate(np.linspace(0.0, 0.05, 6))
            print(name, [float(v[-1]) for v in course.states.values()])
        """
    )
    environment = os.environ | {"BALLSCREW_CACHE": str(tmp_path)}

    def lines(*names):
        done = subprocess.run(
            [sys.executable, "-c", run, *names],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
            cwd=tmp_path,
        )
        return done.stdout.splitlines()

    apart = [*lines("plant"), *lines("nctf"), *lines("pid")]  # each compiles and caches its own
    assert lines("plant", "nctf", "pid") == apart  # one process loads all of them


def test_a_second_process_neither_derives_nor_compiles_again(tmp_path):
    run = textwrap.dedent(
        """
        import sys
        from ballscrew.fmus.catalogue import fmu_kernel
        from ballscrew.solver.kernel import Model
        model = Model(fmu_kernel("plant"))
        model.set_input("u", 30.0)
        model.advance(0.0, 1e-3)
        stats = model.kernel.functions.advance.stats
        print("sympy" in sys.modules, sum(stats.cache_misses.values()))
        """
    )
    environment = os.environ | {"BALLSCREW_CACHE": str(tmp_path)}
    answers = [
        subprocess.run(
            [sys.executable, "-c", run],
            check=True,
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
        ).stdout.split()
        for _ in range(2)
    ]
    assert answers == [["True", "1"], ["False", "0"]]
