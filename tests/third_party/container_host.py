"""Pack a loop into one FMU with fmu_manipulation_toolbox, and run that through fmpy.

``sequential`` in the job chooses the container's schedule: its parts one after the other in the
order given, or all from the same inputs.
"""

from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmu_manipulation_toolbox.assembly import AssemblyNode
from job import JOB, answer, answer_with_time

STEP, OUTPUTS, LOOP = JOB["step"], JOB["outputs"], Path.cwd() / "loop.fmu"


def pack():
    automatic = dict.fromkeys(("auto_link", "auto_input", "auto_output"), False)
    sequential = JOB.get("sequential", False)
    container = AssemblyNode(LOOP.name, step_size=STEP, sequential=sequential, **automatic)
    for name, path in JOB["fmus"].items():
        container.add_fmu(f"{name}.fmu", path)
    for (source, output), (sink, inlet) in JOB["connections"]:
        container.add_link(f"{source}.fmu", output, f"{sink}.fmu", inlet)
    for name, variable, value in JOB["starts"]:
        container.add_start_value(f"{name}.fmu", variable, repr(value))
    for name in OUTPUTS:
        container.add_output("plant.fmu", name, name)
    container.make_fmu(LOOP.parent)


pack()
description = fmpy.read_model_description(str(LOOP))
slave = FMU2Slave(
    guid=description.guid,
    unzipDirectory=fmpy.extract(str(LOOP), unzipdir=str(LOOP.with_suffix(""))),
    modelIdentifier=description.coSimulation.modelIdentifier,
    instanceName="loop",
)
slave.instantiate()
slave.setupExperiment(startTime=0.0)
slave.enterInitializationMode()
slave.exitInitializationMode()
if JOB.get("timed"):
    slave.doStep(0.0, STEP)
    answer_with_time(lambda steps: slave.doStep(STEP, steps * STEP))  # divided by its own step
else:
    variables = {v.name: v.valueReference for v in description.modelVariables}
    wanted = [variables[name] for name in OUTPUTS]
    rows = [slave.getReal(wanted)]
    for k in range(JOB["steps"]):
        slave.doStep(k * STEP, STEP)
        rows.append(slave.getReal(wanted))
    answer(rows)
slave.terminate()
slave.freeInstance()
