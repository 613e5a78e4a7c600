"""Pack a loop into one FMU with fmu_manipulation_toolbox, and run that through fmpy.

``sequential`` in the job chooses the container's schedule: its parts one after the other in the
order given, or all from the same inputs.
"""

import json
import sys
import time
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmu_manipulation_toolbox.assembly import AssemblyNode


def main(job, result):
    slave, variables = opened(packed(job, Path.cwd()))
    step = job["step"]
    if job.get("timed"):
        slave.doStep(0.0, step)
        start = time.perf_counter()
        slave.doStep(step, job["steps"] * step)  # the container divides it by its own step
        result(1e6 * (time.perf_counter() - start) / job["steps"])
    else:
        wanted = [variables[name] for name in job["outputs"]]
        rows = [slave.getReal(wanted)]
        for k in range(job["steps"]):
            slave.doStep(k * step, step)
            rows.append(slave.getReal(wanted))
        result(rows)
    slave.terminate()
    slave.freeInstance()


def packed(job, folder):
    container = AssemblyNode(
        "loop.fmu",
        step_size=job["step"],
        sequential=job.get("sequential", False),
        auto_link=False,
        auto_input=False,
        auto_output=False,
    )
    for name, path in job["fmus"].items():
        container.add_fmu(f"{name}.fmu", path)
    for (source, output), (sink, inlet) in job["connections"]:
        container.add_link(f"{source}.fmu", output, f"{sink}.fmu", inlet)
    for name, variable, value in job["starts"]:
        container.add_start_value(f"{name}.fmu", variable, repr(value))
    for name in job["outputs"]:
        container.add_output("plant.fmu", name, name)
    container.make_fmu(folder)
    return folder / "loop.fmu"


def opened(path):
    description = fmpy.read_model_description(str(path))
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(path), unzipdir=str(path.with_suffix(""))),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="loop",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave, {v.name: v.valueReference for v in description.modelVariables}


main(
    json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")),
    lambda data: Path(sys.argv[2]).write_text(json.dumps(data), encoding="utf-8"),
)
