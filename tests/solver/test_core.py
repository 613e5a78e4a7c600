"""The compiled core on all its roads, in threads, under sanitizers."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import ballscrew
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver import core
from ballscrew.solver.compilers import compiler_for, own_platform
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.solver.translation import compile_equations


def kernel_of(name):
    return loop_kernel("plant", name.removeprefix("loop_")) if "loop_" in name else fmu_kernel(name)


def driven(model):
    """Inputs that move everything there is."""
    for k, signal in enumerate(model.kernel.inputs):
        model.u[k] = signal.start + 0.3 * signal.nominal
    return model


@pytest.mark.parametrize(
    "name",
    [
        *("plant", "plant_classical", "plant_maxwell_slip", "loop_iol", "loop_nctf"),
        *(pytest.param(n, marks=pytest.mark.ci) for n in ("pid_sampled", "relay", "loop_pid")),
    ],
)
def test_tapes_and_compiled_equations_give_the_same_numbers(name):
    kernel = kernel_of(name)
    assert compile_equations(kernel.module, kernel.source, len(kernel.states))
    courses = []
    for road in ("tapes", "compiled"):
        vars(kernel).pop("_compiled", None)
        if road == "tapes":
            vars(kernel)["_compiled"] = ""
        model = driven(Model(kernel))
        if model.sample_time:
            model.sample(0.0)
        seen = []
        for k in range(20):
            if len(model.x):
                model.advance(1e-3 * k, 1e-3 * (k + 1))
            seen += [*model.x, *model.outputs(1e-3 * (k + 1), model.x).values(), *model.info]
        courses.append(seen)
    assert courses[0] == courses[1]


def test_threads_with_models_of_one_kernel_do_not_disturb_each_other():
    kernel = loop_kernel("plant", "nctf")
    grid = np.linspace(0.0, 0.5, 51)

    def run(_):
        return follow_tangents(Model(kernel), grid).growth

    alone = run(0)
    with ThreadPoolExecutor(4) as threads:
        assert all(np.array_equal(found, alone) for found in threads.map(run, range(8)))


def test_what_is_not_an_array_of_floats_is_refused_before_the_core_sees_it():
    model = Model(fmu_kernel("plant"))
    with pytest.raises(TypeError, match="floats without gaps"):
        model.system.rhs(0.0, model.x.astype(np.float32), model.u, model.p, np.empty(4))
    with pytest.raises(TypeError, match="floats without gaps"):
        model.system.rhs(0.0, np.zeros(8)[::2], model.u, model.p, np.empty(4))


EVERYTHING = """
import numpy as np
from ballscrew.orchestration.loop.catalogue import NAMES, fmu_kernel
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.kernel import IntegrationError, Model
from ballscrew.solver.spectrum import follow_tangents, follow_returns
random = np.random.default_rng(1)
for name in NAMES:
    kernel = fmu_kernel(name)
    for wild in (0.0, 1.0, 1e3):
        model = Model(kernel)
        size = np.array([i.nominal for i in kernel.inputs])
        model.u[: len(size)] += wild * size * random.standard_normal(len(size))
        try:
            if kernel.discrete:
                model.sample(0.0)
            model.settle(0.0)
            model.advance(0.0, 0.01)
            model.outputs(0.01, model.x)
        except IntegrationError:
            pass
for name in ("iol", "nctf", "pid"):
    kernel = loop_kernel("plant", name)
    for count in (1, 2, len(kernel.states)):
        follow_tangents(Model(kernel), np.linspace(0.0, 0.05, 6), count)
    follow_returns(Model(kernel), 0.0, 0.2, 0, 1e-3, 3)
model = Model(loop_kernel("plant_maxwell_slip", "pid"))
model.simulate(np.linspace(0.0, 0.03, 4))
print("done")
"""


def sanitizer():
    """The address sanitizer's library; empty where the compiler has none."""
    if not compiler_for(own_platform()) or sys.platform != "linux":
        return ""
    found = subprocess.run(
        ["cc", "-print-file-name=libasan.so"], capture_output=True, text=True
    ).stdout.strip()
    return found if os.path.isabs(found) else ""


@pytest.mark.prove
def test_sanitizers_find_nothing_in_the_core_as_the_package_calls_it(tmp_path):
    if not sanitizer():
        pytest.skip("the compiler has no address sanitizer")
    package = tmp_path / "ballscrew"
    shutil.copytree(
        Path(ballscrew.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    folder = package / "solver" / "c"
    command = ["cc", "-std=c99", "-O1", "-g", "-ffp-contract=off", "-fPIC", "-shared"]
    command += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    subprocess.run([*command, "-o", core.LIBRARY, "core.c", "-lm"], cwd=folder, check=True)
    environment = os.environ | {
        "LD_PRELOAD": sanitizer(),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python's own
        "PYTHONPATH": str(tmp_path),
        "PYTHONMALLOC": "malloc",
    }
    done = subprocess.run(
        [sys.executable, "-c", EVERYTHING],
        capture_output=True,
        text=True,
        env=environment,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.strip().endswith("done")
