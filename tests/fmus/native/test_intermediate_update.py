"""FMI 3.0: a host that looks into a step of co-simulation, and one that ends it there."""

import math
import zipfile
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
from every_component import EVERY_COMPONENT
from fmpy.fmi3 import FMU3Slave

from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

STEP = 1e-3


def intermediate(path):
    """Value references, by name, of what may be looked at within a step; fmpy does not read it."""
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    return {
        v.get("name"): int(v.get("valueReference"))
        for v in root.find("ModelVariables")
        if v.get("intermediateUpdate") == "true"
    }


@dataclass
class Instant:
    time: float
    may_return: bool
    values: list[float]


@dataclass
class Host:
    """An instance, and what it was told of; `act(host, instant)` is what the host does then.

    What `act` returns is the time to return at; None for none.
    """

    path: object
    act: object = None
    early: bool = False
    reads: bool = True
    required: list[int] | None = None
    told: list[Instant] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)
    failed: list[BaseException] = field(default_factory=list)

    def __post_init__(self):
        description = fmpy.read_model_description(str(self.path))
        self.at = {v.name: v.valueReference for v in description.modelVariables}
        self.names = intermediate(self.path)
        if self.required is None:
            self.required = list(self.names.values())
        self.slave = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=fmpy.extract(str(self.path)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="instance",
        )

    def start(self, values, *, callback=True):
        self.slave.instantiate(
            logMessage=lambda _e, _s, _c, text: self.heard.append(text.decode()),
            earlyReturnAllowed=self.early,
            intermediateUpdate=self.update if callback else None,
            requiredIntermediateVariables=self.required,
        )
        for name, value in values.items():
            self.slave.setFloat64([self.at[name]], [value])
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def update(self, _environment, time, set_asked, get, finished, may_return, asked, until):
        try:
            assert (set_asked, get, finished) == (False, True, True)
            assert (asked[0], until[0]) == (False, time)
            values = self.slave.getFloat64(list(self.required)) if self.reads else []
            self.told.append(Instant(time, may_return, values))
            wanted = self.act(self, self.told[-1]) if self.act else None
            if wanted is not None:
                asked[0], until[0] = True, wanted
        except BaseException as error:  # ctypes would drop it, and pytest's are no Exceptions
            self.failed.append(error)

    def step(self, time, step=STEP):
        """Whether the step ended early, and when it ended."""
        event, terminate, early, last = self.slave.doStep(time, step)
        if self.failed:
            raise self.failed[0]
        assert (event, terminate) == (False, False)
        return early, last

    def get(self, *names):
        return self.slave.getFloat64([self.at[n] for n in names])

    def close(self):
        self.slave.terminate()
        self.slave.freeInstance()


def test_what_changes_within_a_step_can_be_looked_at_and_nothing_else(native):
    kernel = fmu_kernel("plant")
    outputs = {o.name for o in kernel.outputs}
    derivatives = {f"der({s.name})" for s in kernel.states}
    assert set(intermediate(native("plant", 3))) == outputs | derivatives
    assert "u" not in intermediate(native("pid_sampled", 3))  # held from sample to sample
    simulation = fmpy.read_model_description(str(native("plant", 3))).coSimulation
    assert simulation.providesIntermediateUpdate
    assert simulation.canReturnEarlyAfterIntermediateUpdate
    assert not simulation.mightReturnEarlyFromDoStep  # never unasked


@pytest.mark.parametrize("name", ["plant", "plant_classical"])
def test_the_host_is_told_of_every_internal_step_with_the_solution_there(native, name):
    """Dry friction, too, which breaks loose within the first step, at an event."""
    host = Host(native(name, 3)).start({"u": 20.0})
    for k in range(20):
        told = len(host.told)
        assert host.step(k * STEP) == (False, k * STEP + STEP)
        times = [i.time for i in host.told[told:]]
        assert times == sorted(times)
        assert times[0] > k * STEP
        assert times[-1] == k * STEP + STEP
    assert len(host.told) > 60
    assert not any(i.may_return for i in host.told)
    model = Model(fmu_kernel(name), tolerance=1e-11)
    model.set_input("u", 20.0)
    truth = model.simulate(np.array([0.0, *(i.time for i in host.told)])).outputs
    names = list(host.names)
    for signal in ("x", "v", "i"):
        seen = np.array([i.values[names.index(signal)] for i in host.told])
        assert np.abs(seen - truth[signal][1:]).max() < 1e-6 * np.ptp(truth[signal]), signal
    slopes = np.array([i.values[names.index("der(x)")] for i in host.told])
    assert slopes.tolist() == [i.values[names.index("v")] for i in host.told]
    host.close()


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_a_host_that_only_looks_changes_no_bit(native, name):
    kernel = fmu_kernel(name)
    inputs = [i.name for i in kernel.inputs if i.role != "internal"]
    outputs = [o.name for o in kernel.outputs]

    def rows(callback, reads):
        host = Host(native(name, 3), reads=reads, early=True).start({}, callback=callback)
        random = np.random.default_rng(8)
        table = []
        for k in range(30):
            values = list(random.normal(size=len(inputs)) * 1e-2)
            host.slave.setFloat64([host.at[n] for n in inputs], values)
            host.step(k * STEP)
            table.append(host.get(*outputs))
        host.close()
        assert bool(host.told) == callback
        return table

    undisturbed = rows(callback=False, reads=False)
    assert rows(callback=True, reads=False) == undisturbed
    assert rows(callback=True, reads=True) == undisturbed


@pytest.mark.parametrize("name", ["plant", "plant_classical"])
def test_a_step_ends_where_the_host_says_with_what_it_saw_there(native, name):
    """At every one of the internal steps of a step, in turn; the voltage rises within it."""
    rising = {"u": 20.0, "u_rate": 1e4}
    whole = Host(native(name, 3), early=True).start(rising)
    whole.step(0.0)
    assert [i.may_return for i in whole.told] == [True] * (len(whole.told) - 1) + [False]
    for k, instant in enumerate(whole.told[:-1]):
        host = Host(
            native(name, 3),
            lambda h, i, k=k: i.time if len(h.told) == k + 1 else None,
            early=True,
        ).start(rising)
        early, last = host.step(0.0)
        assert (early, last) == (True, instant.time)
        assert len(host.told) == k + 1
        assert host.slave.getFloat64(list(host.names.values())) == instant.values
        host.close()
    whole.close()


@pytest.mark.parametrize("name", ["plant", "plant_classical", "plant_maxwell_slip"])
def test_going_on_from_where_a_step_was_ended_gives_the_solution(native, name):
    """Ended at instants of the solver's, or at times between those."""
    random = np.random.default_rng(9)

    def now_or_soon(_host, instant):
        chance = random.random()
        if chance < 0.05:
            return instant.time
        return instant.time + random.random() * STEP if chance < 0.1 else None

    broken = Host(native(name, 3), now_or_soon, early=True).start({"u": 20.0})
    whole = Host(native(name, 3)).start({"u": 20.0}, callback=False)
    ended = 0
    rows = []
    for k in range(200):
        time, end = k * STEP, (k + 1) * STEP
        voltage = 20.0 * math.cos(60.0 * time)
        for host in (broken, whole):
            host.slave.setFloat64([host.at["u"]], [voltage])
        whole.step(time, end - time)
        while time < end:
            early, time = broken.step(time, end - time)
            ended += early
            assert early == (time < end)
        rows.append((broken.get("x", "v", "i"), whole.get("x", "v", "i")))
    assert ended > 50
    ours, truth = np.array(rows).transpose(1, 0, 2)
    assert (np.abs(ours - truth).max(axis=0) < 1e-6 * np.ptp(truth, axis=0)).all()
    broken.close()
    whole.close()


def test_a_time_to_return_at_is_met_exactly_and_one_that_makes_no_sense_is_now(native):
    ends = []
    for wanted in (0.5 * STEP, 0.0, -1.0, math.nan, STEP, 2 * STEP, math.inf):
        host = Host(native("plant", 3), lambda _h, _i, t=wanted: t, early=True)
        ends.append(host.start({"u": 20.0}).step(0.0))
        first = host.told[0].time
        host.close()
    assert ends == [(True, 0.5 * STEP)] + [(True, first)] * 3 + [(False, STEP)] * 3


def test_without_leave_at_instantiation_a_wish_to_return_is_not_heard(native):
    host = Host(native("plant", 3), lambda _h, i: i.time).start({"u": 20.0})
    assert host.step(0.0) == (False, STEP)
    assert not any(i.may_return for i in host.told)
    host.close()


def test_a_step_can_be_ended_at_each_sample_and_no_sample_is_lost_or_taken_twice(native):
    whole = Host(native("pid_sampled", 3)).start({"x_d": 0.08}, callback=False)
    broken = Host(native("pid_sampled", 3), lambda _h, i: i.time, early=True)
    broken.start({"x_d": 0.08})
    time, seen = 0.0, {}
    while time < 9.5 * STEP:
        broken.slave.setFloat64([broken.at["x"]], [1e-3 * round(time / STEP)])
        _, time = broken.step(time, 9.5 * STEP - time)
        seen[round(time / STEP, 6)] = broken.get("u")
    expected = {}
    for k in range(10):
        whole.slave.setFloat64([whole.at["x"]], [1e-3 * k])
        whole.step(k * STEP, 0.5 * STEP)
        expected[float(k)] = whole.get("u")
        whole.step((k + 0.5) * STEP, 0.5 * STEP)
    assert {k: seen[k] for k in expected} == expected
    assert len({tuple(u) for u in expected.values()}) == 10
    whole.close()
    broken.close()


def test_a_state_saved_where_a_step_was_ended_goes_on_bit_for_bit(native):
    host = Host(native("plant_classical", 3), lambda _h, i: i.time, early=True)
    host.start({"u": 20.0})
    _, time = host.step(0.0)
    host.act = None
    state = host.slave.getFMUState()
    rows = []
    for _ in range(2):
        host.slave.setFMUState(state)
        host.step(time, 0.01 - time)
        rows.append(host.get("x", "v", "i"))
    assert rows[0] == rows[1]
    host.slave.freeFMUState(state)
    host.close()


def test_only_what_was_required_at_instantiation_can_be_looked_at(native):
    path = native("plant", 3)
    x, v = (intermediate(path)[n] for n in ("x", "v"))

    def look(host, _instant):
        with pytest.raises(Exception, match="fmi3GetFloat64"):
            host.slave.getFloat64([v])
        assert host.heard[-1].startswith("instance: v cannot be had in an intermediate update")

    host = Host(path, look, required=[x]).start({"u": 20.0})
    host.step(0.0)
    assert host.told
    assert host.get("v") != [0.0]  # between steps it can
    host.close()
    for name, said in (
        ("R", "R cannot be an intermediate variable"),
        ("u", "u cannot be an intermediate variable"),
        ("message", "message cannot be an intermediate variable"),
        (None, "no variable has the value reference 4000000"),
    ):
        host = Host(path)
        host.required = [x, host.at[name] if name else 4_000_000]
        with pytest.raises(Exception, match="Failed to instantiate"):
            host.start({})
        assert host.heard == [f"instance: {said}"]


def test_what_makes_no_sense_within_a_step_is_refused_and_changes_nothing(native):
    kept = []

    def meddle(host, _instant):
        slave, at = host.slave, host.at
        calls = {
            "fmi3DoStep": lambda: slave.doStep(0.0, STEP),
            "fmi3SetFloat64": lambda: slave.setFloat64([at["u"]], [1.0]),
            "fmi3Terminate": slave.terminate,
            "fmi3Reset": slave.reset,
            "fmi3GetFMUState": slave.getFMUState,
            "fmi3SetFMUState": lambda: slave.setFMUState(kept[0]),
            "fmi3FreeFMUState": lambda: slave.freeFMUState(kept[0]),
            "fmi3SerializedFMUStateSize": lambda: slave.serializeFMUState(kept[0]),
            "fmi3GetDirectionalDerivative": lambda: slave.getDirectionalDerivative(
                [at["der(v)"]], [at["x"]], [1.0]
            ),
            "fmi3EnterInitializationMode": slave.enterInitializationMode,
            "fmi3ExitInitializationMode": slave.exitInitializationMode,
            "fmi3GetString": lambda: slave.getString([at["message"]]),
        }
        for name, call in calls.items():
            with pytest.raises(Exception, match=name):
                call()
            said = f"instance: {name} was called in an intermediate update"
            assert host.heard[-1].startswith(said)
        slave.fmi3FreeInstance(slave.component)
        assert host.heard[-1].startswith("instance: fmi3FreeInstance was called in an interm")

    rows = []
    for act in (meddle, None):
        host = Host(native("plant_classical", 3), act).start({"u": 20.0})
        kept[:] = [host.slave.getFMUState()]
        for k in range(5):
            host.step(k * STEP)
            rows.append(host.get("x", "v", "i", "friction"))
        host.close()
    assert rows[:5] == rows[5:]
