"""A loop of two FMUs for any master, and functions to run it in a separate process.

The hosts are the scripts ``*_host.py`` in ``tests/third_party``. Each is started with two paths,
the job to read and the result to write, both JSON, and does not use this project.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import fmpy
import pytest

HOSTS = Path(__file__).parents[1] / "third_party"
OUTPUTS = ("x", "v", "z", "i")
TIMEOUT = 120  # seconds; a host that takes longer hangs


class HostFailed(AssertionError):
    """A host did not end correctly; the message is its output."""


@dataclass(frozen=True)
class WiredLoop:
    """A loop to run: paths by instance, pairs of (instance, port), (instance, variable, value).

    `outputs` of the plant are recorded at every communication point; `step` is in seconds.
    """

    fmus: dict[str, str]
    connections: list[tuple[tuple[str, str], tuple[str, str]]]
    starts: list[tuple[str, str, float]]
    outputs: list[str]
    step: float
    steps: int


def wired(
    plant: Path,
    controller: Path,
    step: float,
    stop: float,
    *,
    law: bool,
    goal: float = 0.08,
    outputs: tuple[str, ...] = OUTPUTS,
) -> WiredLoop:
    """Connect equal names on both sides; without `law`, only ``u`` of the commands."""
    fmus = {"plant": plant, "controller": controller}
    ports = {name: _real_ports(path) for name, path in fmus.items()}
    connections = []
    for source, sink in (("plant", "controller"), ("controller", "plant")):
        for name in ports[source]["output"]:
            if name in ports[sink]["input"] and (law or source == "plant" or name == "u"):
                connections.append(((source, name), (sink, name)))
    return WiredLoop(
        {name: str(path) for name, path in fmus.items()},
        connections,
        [("controller", "x_d", goal)],
        list(outputs),
        step,
        round(stop / step),
    )


def _real_ports(path: Path) -> dict[str, list[str]]:
    variables = fmpy.read_model_description(str(path)).modelVariables
    return {
        causality: [v.name for v in variables if v.causality == causality and v.type == "Real"]
        for causality in ("input", "output")
    }


def run_in(host: str, loop: WiredLoop, **options: Any) -> Any:
    """Run the script ``<host>_host.py`` on this loop; return its result.

    Raises
    ------
    HostFailed
        If its exit code is not 0, by its own error or that of an FMU, or it hangs.
    """
    if host == "ecos" and missing_for_ecos():
        pytest.skip(missing_for_ecos())
    return ask(HOSTS / f"{host}_host.py", asdict(loop) | options)


def ask(
    script: Path, job: dict[str, Any], python: Path | str = sys.executable, timeout: float = TIMEOUT
) -> Any:
    """Run a script on a job in a new process; raises like `run_in`."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / "job.json", Path(folder) / "result.json"]
        paths[0].write_text(json.dumps(job))
        command = [str(python), str(script), *map(str, paths)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=timeout,
                cwd=folder,
                env=os.environ | {"TMPDIR": folder},  # hosts unpack FMUs, and some do not clean up
            )
        except subprocess.TimeoutExpired as error:
            raise HostFailed(f"{script.name} is not done after {timeout} s") from error
        if done.returncode or not paths[1].is_file():
            raise HostFailed(
                f"{script.name} ended with exit code {done.returncode}:\n"
                f"{done.stdout[-2000:]}{done.stderr[-4000:]}"
            )
        return json.loads(paths[1].read_text())


@functools.cache
def missing_for_ecos() -> str:
    """Packages needed to import ecospy; empty if it can be imported."""
    done = subprocess.run(
        [sys.executable, "-c", "import ecospy"], capture_output=True, text=True, timeout=TIMEOUT
    )
    if "libtbb.so.12" in done.stderr:
        return "ecospy needs libtbb.so.12; install Debian's libtbb12"
    return ""
