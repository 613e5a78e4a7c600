"""No order of calls, and no null pointer, size or number, brings a host down."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmpy.fmi2 import FMU2Model

from ballscrew.fmus.native.sources import catalogued_model, is_intermediate

SCRIPT = Path(__file__).with_name("random_calls.py")
CALLS = 100_000
BINARIES = {2: "linux64", 3: "x86_64-linux"}


def test_a_sampling_period_that_makes_no_sense_ends_in_an_error_and_not_in_a_loop(native):
    """In model exchange the host may go on after initialization has failed."""
    path = native("pid_sampled")
    description = fmpy.read_model_description(str(path))
    at = {v.name: v.valueReference for v in description.modelVariables}
    for period in (-1e-3, 0.0, 1e-300):
        model = FMU2Model(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=description.modelExchange.modelIdentifier,
            instanceName="one",
        )
        model.instantiate()
        model.setupExperiment(startTime=0.0)
        model.setReal([at["sample_time"]], [period])
        model.enterInitializationMode()
        with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
            model.exitInitializationMode()
        with pytest.raises(Exception, match="fmi2NewDiscreteStates"):
            model.newDiscreteStates()
        model.freeInstance()


def counts_of_calls(path, name, fmi, library, calls, env=None):
    """How often each function went well and did not, by its name."""
    description = fmpy.read_model_description(str(path))
    variables, model = description.modelVariables, catalogued_model(name)
    references = {
        "inputs": [v.valueReference for v in variables if v.causality == "input"],
        "parameters": [v.valueReference for v in variables if v.causality == "parameter"],
        "outputs": [
            v.valueReference
            for v in variables
            if v.causality in ("output", "local") and v.name != "message"
        ],
        "intermediate": [v.reference for v in model.interface.variables if is_intermediate(v)],
        "states": len(model.kernel.states),
    }
    token = description.guid if fmi == 2 else description.instantiationToken
    command = [sys.executable, SCRIPT, library, token, fmi, json.dumps(references), 2, calls]
    done = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
        env=env,
        timeout=300,
    )
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr[-3000:]}"
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "fmi"), [("plant", 2), ("plant_classical", 3), ("pid_sampled", 3)]
)
def test_a_hundred_thousand_calls_in_random_order_end_in_errors_with_a_message(
    native, tmp_path, name, fmi
):
    """With FMI 3.0 the host calls from within steps, too; there it may do little but look."""
    path = native(name, fmi)
    folder = fmpy.extract(str(path), unzipdir=str(tmp_path))
    library = f"{folder}/binaries/{BINARIES[fmi]}/{name}.so"
    counts = counts_of_calls(path, name, fmi, library, CALLS)
    assert sum(map(sum, counts.values())) >= CALLS
    for needed in ("DoStep", "SetTime", "ExitInitializationMode", "GetDirectionalDerivative"):
        assert min(counts[needed]) > 50, counts  # it neither always fails nor never
    within = {k.removeprefix("within "): v for k, v in counts.items() if k.startswith("within")}
    assert bool(within) == (fmi == 3)
    if within:
        assert min(within.pop("GetFloat64")) > 50, counts
        assert within.pop("SetDebugLogging")[1] == 0
        assert {name for name, (well, _) in within.items() if well} == set(), counts
        assert within["DoStep"][1] > 50, counts


@pytest.mark.parametrize(("name", "fmi"), [("plant_classical", 3), ("plant", 2)])
def test_the_sanitizers_find_nothing_in_calls_in_random_order(native, tmp_path, name, fmi):
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not compiler:
        pytest.skip("needs a C compiler of the system's")
    path = native(name, fmi)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    library = tmp_path / f"{name}.so"
    options = ["-fsanitize=undefined,address", "-fno-sanitize-recover=all", "-g", "-O1"]
    source = tmp_path / "sources" / f"fmi{fmi}.c"
    build = [compiler, "-std=c99", *options, "-fPIC", "-shared", "-o", library, source, "-lm"]
    runtime = subprocess.run(
        [compiler, "-print-file-name=libasan.so"], capture_output=True, text=True
    ).stdout.strip()
    if subprocess.run(build, capture_output=True).returncode or not Path(runtime).is_file():
        pytest.skip("needs a compiler with the sanitizers of addresses and undefined behaviour")
    own = {"LD_PRELOAD": runtime, "ASAN_OPTIONS": "detect_leaks=0"}  # Python's own are many
    counts = counts_of_calls(path, name, fmi, library, CALLS // 5, os.environ | own)
    assert counts["DoStep"][0] > 20
