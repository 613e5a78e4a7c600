"""The command of FMU container on an .ssp; fmpy steps the resulting FMU."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy
from host import answer


def run(job):
    """Run with local variables as outputs, because our .ssp has no connectors."""
    with tempfile.TemporaryDirectory() as folder:
        system = Path(shutil.copy(next(iter(job["fmus"].values())), folder))
        command = Path(sys.executable).with_name("fmucontainer")
        description = f"{system.name}:{job['step']!r}"
        subprocess.run([command, "-container", description, "-auto-local"], cwd=folder, check=True)
        course = fmpy.simulate_fmu(
            str(system.with_suffix(".fmu")),
            stop_time=job["stop"],
            step_size=job["step"],
            output_interval=job["step"],
            output=["plant.x"],
        )
        return course["time"], course["plant.x"]


answer(run)
