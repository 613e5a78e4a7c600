"""No order of calls, and no null pointer, size or number, brings a host down."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy
import pytest

from ballscrew.orchestration.loop.catalogue import catalogued_model

SCRIPT = Path(__file__).with_name("random_calls.py")
BINARIES = {2: "linux64", 3: "x86_64-linux"}


def counts_of_calls(path, name, fmi, library, calls, env=None):
    """How often each function went well and did not, by its name."""
    description = fmpy.read_model_description(str(path))
    variables = description.modelVariables
    references = {
        "inputs": [v.valueReference for v in variables if v.causality == "input"],
        "parameters": [v.valueReference for v in variables if v.causality == "parameter"],
        "outputs": [
            v.valueReference
            for v in variables
            if v.causality in ("output", "local") and v.name != "message"
        ],
        "states": len(catalogued_model(name).kernel.states),
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


def sanitized(folder, fmi):
    """A library of the FMU's sources that finds wrong memory, and the environment that it needs."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not compiler:
        pytest.skip("needs a C compiler of the system's")
    library, source = folder / "sanitized.so", folder / "sources" / f"fmi{fmi}.c"
    options = ["-fsanitize=undefined,address", "-fno-sanitize-recover=all", "-g", "-O1"]
    build = [compiler, "-std=c99", *options, "-fPIC", "-shared", "-o", library, source, "-lm"]
    runtime = subprocess.run(
        [compiler, "-print-file-name=libasan.so"], capture_output=True, text=True
    ).stdout.strip()
    if subprocess.run(build, capture_output=True).returncode or not Path(runtime).is_file():
        pytest.skip("needs a compiler with the sanitizers of addresses and undefined behaviour")
    # leaks of Python's own are many
    return library, os.environ | {"LD_PRELOAD": runtime, "ASAN_OPTIONS": "detect_leaks=0"}


def of(name, fmi, calls, watched, tier):
    return pytest.param(name, fmi, calls, watched, marks=tier, id=f"{name}-{fmi}-{calls}")


@pytest.mark.parametrize(
    ("name", "fmi", "calls", "watched"),
    [
        of("plant_classical", 2, 10_000, True, pytest.mark.ci),
        of("plant_classical", 3, 20_000, True, pytest.mark.prove),
        of("plant", 2, 100_000, False, pytest.mark.prove),
        of("pid_sampled", 3, 100_000, False, pytest.mark.prove),
    ],
)
def test_a_hundred_thousand_calls_in_random_order_end_in_errors_with_a_message(
    native, tmp_path, name, fmi, calls, watched
):
    """Some of them in an FMU that sanitizers watch."""
    path = native(name, fmi)
    folder = Path(fmpy.extract(str(path), unzipdir=str(tmp_path)))
    library, environment = folder / "binaries" / BINARIES[fmi] / f"{name}.so", None
    if watched:
        library, environment = sanitized(folder, fmi)
    counts = counts_of_calls(path, name, fmi, library, calls, environment)
    assert sum(map(sum, counts.values())) >= calls
    for needed in ("DoStep", "SetTime", "ExitInitializationMode", "GetDirectionalDerivative"):
        assert min(counts[needed]) > calls // 2000, counts  # it neither always fails nor never
