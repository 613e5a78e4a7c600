"""The native FMUs of FMI 3.0: the same numbers as those of FMI 2.0, and what only 3.0 has."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from every_component import EVERY_COMPONENT
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from fmu_host import opened

from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import catalogued_model


def slave_of(path, values=None):
    """An initialized co-simulation instance and its value references by name."""
    description = fmpy.read_model_description(str(path))
    slave = FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=fmpy.extract(str(path)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="instance",
    )
    at = {v.name: v.valueReference for v in description.modelVariables}
    heard = []
    slave.instantiate(logMessage=lambda _e, _s, _c, text: heard.append(text.decode()))
    for name, value in (values or {}).items():
        slave.setFloat64([at[name]], [value])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave, at, heard


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_fmpy_validates_without_a_message(native, name):
    assert validate_fmu(str(native(name, 3))) == []


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_variables_are_those_of_fmi_2_with_the_same_references_and_starts(native, name):
    def table(path):
        fields = "valueReference causality variability unit min max nominal start"
        variables = fmpy.read_model_description(str(path)).modelVariables
        return {v.name: [getattr(v, f) for f in fields.split()] for v in variables}

    two, three = table(native(name)), table(native(name, 3))
    message = two.pop("message")
    assert {n: three[n] for n in two} == two
    assert three["message"][:3] == message[:3]
    more = {n for n in three if n not in two and not n.startswith("event_indicator_")}
    assert more == {"message", "time"}


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_both_versions_give_the_same_numbers_to_the_last_bit(native, name):
    kernel = fmu_kernel(name)
    inputs = [i.name for i in kernel.inputs if i.role != "internal"]
    outputs = [o.name for o in kernel.outputs]
    two, at_two = opened(native(name))
    three, at_three, _ = slave_of(native(name, 3))
    random = np.random.default_rng(6)
    for k in range(50):
        values = list(random.normal(size=len(inputs)) * 1e-2)
        two.setReal([at_two[n] for n in inputs], values)
        three.setFloat64([at_three[n] for n in inputs], values)
        two.doStep(k * 1e-3, 1e-3)
        assert three.doStep(k * 1e-3, 1e-3)[-1] == k * 1e-3 + 1e-3
        expected = two.getReal([at_two[n] for n in outputs])
        assert three.getFloat64([at_three[n] for n in outputs]) == expected
    for slave in (two, three):
        slave.terminate()
        slave.freeInstance()


@pytest.mark.parametrize("name", ["plant", "plant_classical", "nctf", "pid_sampled"])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_fmpy_runs_both_kinds_as_it_runs_those_of_fmi_2(native, name, kind):
    start = {"x_d": 0.08} if "plant" not in name else {"u": 5.0}
    outputs = ["u"] if "plant" not in name else ["x", "v", "i"]
    runs = [
        fmpy.simulate_fmu(
            str(native(name, fmi)),
            fmi_type=kind,
            stop_time=0.1,
            output_interval=1e-3,
            relative_tolerance=1e-8,
            start_values=start,
            output=outputs,
        )
        for fmi in (2, 3)
    ]
    for output in outputs:
        a, b = (run[output] for run in runs)
        assert np.ptp(a) > 0
        assert len(a) == len(b)
        assert np.abs(a - b).max() <= 1e-6 * np.ptp(a)


@pytest.mark.parametrize("name", ["plant", "iol", "nctf", "plant_maxwell_slip"])
def test_adjoint_derivatives_are_directional_ones_transposed(native, name):
    model = catalogued_model(name)
    random = np.random.default_rng(7)
    signals = [i for i in model.kernel.inputs if i.role != "internal"]
    starts = {f"{s.name}_start": s.nominal * random.normal() for s in model.kernel.states}
    slave, at, _ = slave_of(native(name, 3), starts | {i.name: 1e-3 for i in signals})
    knowns = [v.reference for v in model.state_variables] + [at[i.name] for i in signals]
    unknowns = [v.reference for v in model.derivatives] + [at[o.name] for o in model.kernel.outputs]
    forward = np.column_stack(
        [slave.getDirectionalDerivative(unknowns, [k], [1.0]) for k in knowns]
    )
    n = len(knowns)  # left out, fmpy makes room for as many as there are unknowns
    adjoint = np.vstack([slave.getAdjointDerivative([u], knowns, [1.0], n) for u in unknowns])
    assert adjoint.tolist() == forward.tolist()
    assert np.abs(forward).max() > 0
    seed = random.normal(size=len(unknowns))
    product = slave.getAdjointDerivative(unknowns, knowns, list(seed), n)
    size = np.abs(seed) @ np.abs(forward)
    assert (np.abs(product - seed @ forward) <= 1e-14 * size).all()
    slave.freeInstance()


def test_a_state_serialized_in_one_process_goes_on_in_another(native, tmp_path):
    code = """
        import sys, fmpy
        from pathlib import Path
        from fmpy.fmi3 import FMU3Slave
        description = fmpy.read_model_description(sys.argv[1])
        slave = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=fmpy.extract(sys.argv[1]),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        at = {v.name: v.valueReference for v in description.modelVariables}
        slave.instantiate()
        slave.setFloat64([at["u"]], [20.0])
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        file = Path(sys.argv[2])
        if file.exists():
            slave.setFMUState(slave.deserializeFMUState(file.read_bytes()))
        else:
            for k in range(30):
                slave.doStep(k * 1e-3, 1e-3)
            file.write_bytes(bytes(slave.serializeFMUState(slave.getFMUState())))
        for k in range(30, 60):
            slave.doStep(k * 1e-3, 1e-3)
        print([v.hex() for v in slave.getFloat64([at[n] for n in ("x", "v", "z", "i")])])
    """
    runs = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(code), native("plant", 3), tmp_path / "state"],
            capture_output=True,
            text=True,
            cwd=tempfile.gettempdir(),
            env=os.environ,
        )
        assert done.returncode == 0, done.stderr
        runs.append(done.stdout)
    assert runs[0] == runs[1] != ""


def test_a_call_that_makes_no_sense_is_refused_with_a_message_and_changes_nothing(native):
    slave, at, heard = slave_of(native("plant", 3), {"u": 5.0})
    slave.doStep(0.0, 1e-3)
    before = slave.getFloat64([at["x"], at["v"]])
    for call, words in (
        (lambda: slave.setFloat64([at["R"]], [1.0]), "R cannot be set any more"),
        (lambda: slave.setFloat64([at["x"]], [1.0]), "x cannot be set"),
        (lambda: slave.setFloat64([4_000_000], [1.0]), "4000000"),
        (lambda: slave.enterEventMode(), "model exchange"),
        (lambda: slave.exitInitializationMode(), "between steps of co-simulation"),
    ):
        with pytest.raises(Exception, match="fmi3"):
            call()
        assert words in heard[-1]
        assert heard[-1].startswith("instance: ")
    assert slave.getFloat64([at["x"], at["v"]]) == before
    slave.doStep(1e-3, 1e-3)
    slave.terminate()
    slave.freeInstance()


def test_the_variational_fmu_is_for_co_simulation_and_says_so(tmp_path):
    path = write_native(catalogued_model("nctf", tangents=1), tmp_path / "v.fmu", 3).path
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path))
    assert description.modelExchange is None
    slave, at, _ = slave_of(path, {"x_d": 0.08})
    slave.setFloat64([at["x_d1"]], [1.0])
    slave.doStep(0.0, 1e-3)
    assert slave.getFloat64([at["u_d1"]])[0] != 0.0
    slave.terminate()
    slave.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_every_function_is_as_the_official_headers_declare_it(native, tmp_path, fmi):
    """The compiler compares, with the headers that fmpy ships in place of our declarations."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not compiler:
        pytest.skip("needs a C compiler of the system's")
    headers = Path(fmpy.__file__).parent / "c-code"
    with zipfile.ZipFile(native("plant", fmi)) as archive:
        archive.extractall(tmp_path)
    own = tmp_path / "sources" / f"fmi{fmi}_declarations.h"
    own.write_text(f'#include "fmi{fmi}Functions.h"\n')
    library = tmp_path / "plant.so"
    command = [compiler, "-std=c99", f"-I{headers}", "-fPIC", "-shared", "-o", library]
    command += [tmp_path / "sources" / f"fmi{fmi}.c", "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]
    listed = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True)
    declared = (headers / f"fmi{fmi}FunctionTypes.h").read_text()
    needed = set(re.findall(rf"\b(fmi{fmi}\w+)TYPE\b", declared))
    assert needed <= {line.split()[-1] for line in listed.stdout.splitlines()}
    assert len(needed) > 30
