"""A tolerance that the host gives replaces `solver_tolerance`, in both kinds of FMU."""

import fmpy
import pytest
from fmpy.fmi2 import FMU2Slave


def begun(path, given, afterwards=None):
    """`solver_tolerance` after initialization; the host gives a tolerance, or none."""
    description = fmpy.read_model_description(str(path))
    (place,) = (
        v.valueReference for v in description.modelVariables if v.name == "solver_tolerance"
    )
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(path)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="instance",
    )
    slave.instantiate()
    slave.setReal([place], [1e-9])
    slave.setupExperiment(tolerance=given, startTime=0.0)
    if afterwards:
        slave.setReal([place], [afterwards])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    (value,) = slave.getReal([place])
    slave.terminate()
    slave.freeInstance()
    return value


@pytest.mark.parametrize("kind", ["pythonfmu", "native"])
def test_the_host_s_tolerance_replaces_the_parameter_and_a_later_setting_that(fmus, native, kind):
    path = fmus["plant"] if kind == "pythonfmu" else native("plant")
    assert begun(path, None) == 1e-9
    assert begun(path, 1e-4) == 1e-4
    assert begun(path, 1e-4, afterwards=1e-8) == 1e-8
