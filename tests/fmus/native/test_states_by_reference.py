"""Continuous states set one by one, by fmi2SetReal and fmi3SetFloat64.

Both versions let a host of model exchange do that in event and continuous-time mode (FMI 2.0.5,
section 3.2.3; FMI 3.0.2, sections 2.3.5 and 3.2.1). CasADi sets them in no other way.
"""

import ctypes

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave

from ballscrew.fmus.native.sources import catalogued_model

NAMES = ["plant", "nctf", "plant_classical"]  # states that are outputs, one that is not, modes


class Host:
    """An instance of either version that has been initialized, with one name for each call."""

    def __init__(self, path, fmi, exchange=True):
        described = fmpy.read_model_description(str(path))
        self.at = {v.name: v.valueReference for v in described.modelVariables}
        kinds = {2: (FMU2Slave, FMU2Model), 3: (FMU3Slave, FMU3Model)}
        kind = described.modelExchange if exchange else described.coSimulation
        self.fmu = kinds[fmi][exchange](
            guid=described.guid or described.instantiationToken,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=kind.modelIdentifier,
            instanceName="one",
        )
        self.fmi = fmi
        self.fmu.instantiate()

    def initialize(self):
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, names, values):
        call = self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64
        call([self.at[n] for n in names], list(values))

    def get(self, names):
        call = self.fmu.getReal if self.fmi == 2 else self.fmu.getFloat64
        return np.array(call([self.at[n] for n in names]))

    def set_all(self, values):
        self.fmu.setContinuousStates((ctypes.c_double * len(values))(*values), len(values))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("mode", ["event", "continuous-time"])
@pytest.mark.parametrize("name", NAMES)
def test_states_set_one_by_one_are_those_set_all_at_once(native, name, mode, fmi):
    model = catalogued_model(name)
    states = [v.name for v in model.state_variables]
    unknowns = [v.name for v in model.derivatives] + [o.name for o in model.kernel.outputs]
    random = np.random.default_rng(8)
    whole, single = (Host(native(name, fmi), fmi) for _ in range(2))
    for host in (whole, single):
        host.initialize()
        if mode == "continuous-time":
            host.fmu.enterContinuousTimeMode()
    for _ in range(5):
        values = [s.nominal * random.normal() for s in model.kernel.states]
        whole.set_all(values)
        for k in random.permutation(len(states)):
            single.set([states[k]], [values[k]])
        assert single.get(states).tolist() == values
        assert single.get(unknowns).tolist() == whole.get(unknowns).tolist()
    for host in (whole, single):
        host.fmu.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_states_cannot_be_set_where_the_standards_do_not_allow_it(native, fmi):
    """Before initialization ends they have start values; in co-simulation they are the FMU's."""
    stepping = Host(native("plant", fmi), fmi, exchange=False)
    stepping.initialize()
    early = Host(native("plant", fmi), fmi)
    for host, names in ((stepping, ["x"]), (early, ["x"])):
        before = host.get(["x", "v"])
        with pytest.raises(Exception, match="rror"):
            host.set(names, [0.01])
        assert host.get(["x", "v"]).tolist() == before.tolist()
    early.initialize()
    for name in ("friction", "der(v)"):  # no states
        with pytest.raises(Exception, match="rror"):
            early.set([name], [0.01])
    for host in (stepping, early):
        host.fmu.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_state_that_is_no_number_is_refused_and_the_solver_can_try_another(native, fmi):
    host = Host(native("plant", fmi), fmi)
    host.initialize()
    host.fmu.enterContinuousTimeMode()
    host.set(["x"], [0.01])
    with pytest.raises(Exception, match="rror"):
        host.set(["v", "x"], [0.1, float("nan")])
    assert host.get(["x", "v"]).tolist() == [0.01, 0.0]
    host.set(["x"], [0.02])
    host.fmu.enterEventMode()
    (host.fmu.newDiscreteStates if fmi == 2 else host.fmu.updateDiscreteStates)()
    assert host.get(["x"]).tolist() == [0.02]
    host.fmu.freeInstance()
