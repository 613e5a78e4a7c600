"""A minimal FMI host for tests: open an FMU through fmpy and find its variables by name."""

import fmpy
from fmpy.fmi2 import FMU2Slave


def opened(path, values=None, name="instance", *, logged=False):
    """An initialized slave and its value references by name."""
    description = fmpy.read_model_description(str(path))
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(path)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName=name,
    )
    references = {v.name: v.valueReference for v in description.modelVariables}
    slave.instantiate(loggingOn=logged)
    slave.setupExperiment(startTime=0.0)
    for key, value in (values or {}).items():
        slave.setReal([references[key]], [value])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave, references
