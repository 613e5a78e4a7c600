"""What the model descriptions say that unknowns depend on, against what moves them."""

import ctypes
import zipfile
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
import sympy as sp
from fmpy.fmi2 import FMU2Model
from fmpy.validation import validate_fmu
from fmu_host import opened

from ballscrew.fmus.catalogue import NAMES, fmu_kernel
from ballscrew.fmus.native.export import export_native
from ballscrew.fmus.native.sources import catalogued_model
from ballscrew.instruments import INSTRUMENTS
from ballscrew.solver.component import Component, Input, Mode, Output, Parameter, State, symbol

POINTS = 60


def listed(path):
    """Kinds of dependencies by the names of unknown and known, in FMI 2 or 3."""
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    two = root.get("fmiVersion") == "2.0"
    key = "index" if two else "valueReference"
    variables = list(root.find("ModelVariables"))
    names = {
        str(k + 1) if two else v.get("valueReference"): v.get("name")
        for k, v in enumerate(variables)
    }
    kinds = ("Outputs/*", "Derivatives/*") if two else ("Output", "ContinuousStateDerivative")
    found = {}
    for kind in kinds:
        for unknown in root.find("ModelStructure").findall(kind):
            known = unknown.get("dependencies").split()
            kinds = unknown.get("dependenciesKind", "").split()
            own = {names[k]: kind for k, kind in zip(known, kinds, strict=True)}
            found[names[unknown.get(key)]] = own
    found.pop("message")
    return found


class Probe:
    """A model-exchange instance of FMI 2.0, set to points and moved away from them."""

    def __init__(self, path):
        description = fmpy.read_model_description(str(path))
        self.at = {v.name: v.valueReference for v in description.modelVariables}
        self.model = FMU2Model(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=description.modelExchange.modelIdentifier,
            instanceName="instance",
        )
        self.model.instantiate()

    def go(self, values):
        self.model.reset()
        self.model.setupExperiment(startTime=0.0)
        self.model.setReal([self.at[n] for n in values], list(values.values()))
        self.model.enterInitializationMode()
        self.model.exitInitializationMode()
        self.model.newDiscreteStates()

    def set_states(self, values):
        if len(values):
            self.model.setContinuousStates((ctypes.c_double * len(values))(*values), len(values))

    def get(self, names):
        return np.array(self.model.getReal([self.at[n] for n in names]))


def what_moves(path, name):
    """By unknown and known: whether the unknown took another value wherever the known did."""
    kernel, model = fmu_kernel(name), catalogued_model(name)
    random = np.random.default_rng(12)
    inputs = [i for i in kernel.inputs if i.role != "internal"]
    states = [v.name for v in model.state_variables]
    unknowns = [o.name for o in kernel.outputs] + [d.name for d in model.derivatives]
    moved = {u: set() for u in unknowns}
    probe = Probe(path)
    limited = "u_max" in {p.name for p in kernel.parameters}

    def value(nominal):
        return float(nominal * random.normal() * 10 ** random.uniform(-2, 1.5))

    for k in range(POINTS):
        start = {f"{s.name}_start": value(s.nominal) for s in kernel.states}
        if "v_start" in start and kernel.modes and k % 2:
            start["v_start"] = 0.0  # sticks
        drive = {i.name: value(i.nominal if i.name != "u" else 10.0) for i in inputs}
        probe.go(start | drive)
        if limited and k % 2:  # within a hair of its limit, which anything may take it over
            probe.go(start | drive | {"u_max": 1e6})
            near = max(abs(probe.get(["u"])[0]) * (1 + 1e-9), 1e-3)
            probe.go(start | drive | {"u_max": near})
        at = probe.get(states)
        before = probe.get(unknowns)

        def moves(known, before=before):
            after = probe.get(unknowns)
            for unknown, a, b in zip(unknowns, before, after, strict=True):
                if a != b:
                    moved[unknown].add(known)

        for j, (s, info) in enumerate(zip(states, kernel.states, strict=True)):
            other = at.copy()
            other[j] = value(info.nominal)
            probe.set_states(other)
            moves(s)
        probe.set_states(at)
        for i in inputs:
            probe.model.setReal([probe.at[i.name]], [value(i.nominal)])
            moves(i.name)
            probe.model.setReal([probe.at[i.name]], [drive[i.name]])
        assert probe.get(unknowns).tolist() == before.tolist()
    probe.model.freeInstance()
    return moved


@pytest.mark.parametrize("name", NAMES)
def test_what_is_listed_moves_an_unknown_somewhere_and_nothing_else_ever_does(native, name):
    moved = what_moves(native(name), name)
    if "u_rate" in (i.name for i in fmu_kernel(name).inputs):
        moved["der(i)"].add("u_rate")  # within a step of co-simulation only
    three = {u: set(known) - {"time"} for u, known in listed(native(name, 3)).items()}
    assert three == moved
    two = {u: set(known) for u, known in listed(native(name)).items()}
    assert two == moved


@pytest.mark.parametrize("name", NAMES)
def test_a_slope_that_is_called_constant_or_fixed_is_the_same_everywhere(native, name):
    kinds = listed(native(name, 3))
    kernel = fmu_kernel(name)
    steady = [
        (unknown, known)
        for unknown, own in kinds.items()
        for known, kind in own.items()
        if kind in ("constant", "fixed")
    ]
    assert steady or kernel.modes or name in INSTRUMENTS  # what is a staircase has no slope
    random = np.random.default_rng(13)
    seen = []
    for _ in range(5):
        values = {f"{s.name}_start": s.nominal * random.normal() for s in kernel.states}
        values |= {i.name: random.normal() for i in kernel.inputs if i.role != "internal"}
        slave, at = opened(native(name), values)
        seen.append([slave.getDirectionalDerivative([at[u]], [at[k]], [1.0])[0] for u, k in steady])
        slave.terminate()
        slave.freeInstance()
    assert all(row == seen[0] for row in seen)
    assert 0.0 not in seen[0]


def test_jumps_and_modes_are_counted_and_time_where_there_is_a_variable_for_it(tmp_path):
    """A jump has no slope, but what it depends on is listed; of modes, whatever one depends on."""
    a, b, s, gain, t = (symbol(n) for n in ("a", "b", "s", "gain", "t"))
    part = Component(
        "part",
        "a part with a jump and two modes",
        parameters=(Parameter("gain", 2.0, "1", "gain", "here"),),
        inputs=(Input("a", "1", "a"), Input("b", "1", "b")),
        states=(State("s", "1", "s", gain * a),),
        outputs=(
            Output("jump", "1", "which side b is on", sp.Heaviside(b)),
            Output("late", "1", "time and s", s + t),
        ),
        modes=(Mode("one"), Mode("two", derivatives={"s": -s})),
    )
    for fmi in (2, 3):
        path = export_native(part, tmp_path / f"{fmi}.fmu", fmi=fmi).path
        assert validate_fmu(str(path)) == []
        found = {u: set(known) for u, known in listed(path).items()}
        assert found["der(s)"] == {"a", "s"}
        assert found["jump"] == {"b"}
        assert found["late"] == ({"s", "time"} if fmi == 3 else {"s"})
