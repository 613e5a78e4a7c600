"""FMI 3.0: a host that looks into a step of co-simulation, and one that ends it there."""

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave

from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

STEP = 1e-3


def test_a_host_is_told_of_internal_steps_and_ends_a_step_where_it_likes(native):
    path = str(native("plant", 3))
    description = fmpy.read_model_description(path)
    assert description.coSimulation.canReturnEarlyAfterIntermediateUpdate
    at = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    told, ends = [], []

    def update(_environment, time, _set, _get, _finished, may_return, asked, until):
        told.append((time, slave.getFloat64([at["x"]])[0], may_return))
        if ends:
            asked[0], until[0] = True, ends.pop()

    required = [at["x"]]
    slave.instantiate(
        earlyReturnAllowed=True, intermediateUpdate=update, requiredIntermediateVariables=required
    )
    slave.setFloat64([at["u"]], [20.0])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    assert slave.doStep(0.0, STEP)[2:] == (False, STEP)
    assert [may for *_, may in told] == [True] * (len(told) - 1) + [False]
    assert told[-1][0] == STEP
    ends[:] = [1.5 * STEP]
    assert slave.doStep(STEP, STEP)[2:] == (True, 1.5 * STEP)
    ends[:] = [0.0]  # past already: the step ends at once
    early, time = slave.doStep(1.5 * STEP, STEP)[2:]
    assert early
    assert 1.5 * STEP < time < 2.5 * STEP
    assert time == told[-1][0]
    model = Model(fmu_kernel("plant"), tolerance=1e-11)
    model.set_input("u", 20.0)
    times, seen, _ = np.array(told).T
    truth = model.simulate(np.array([0.0, *times])).outputs["x"][1:]
    assert np.abs(seen - truth).max() < 1e-6 * np.ptp(truth)
    assert len(told) > 10
    slave.terminate()
    slave.freeInstance()
