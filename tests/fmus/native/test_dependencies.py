"""What the model descriptions say that unknowns depend on, against what moves them."""

import zipfile
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import sympy as sp
from any_fmu import Host
from every_component import EVERY_COMPONENT
from fmpy.validation import validate_fmu

from ballscrew import Component, Delay, Event, Input, Mode, Output, Parameter, State, symbol
from ballscrew.orchestration.loop.catalogue import catalogued_model, fmu_kernel
from ballscrew.plant.instruments import INSTRUMENTS

POINTS = 60
EXACTLY = "plant", "nctf", "iol", "position_encoder"


def listed(path, kinds=None):
    """Kinds of dependencies by the names of unknown and known, in FMI 2 or 3.

    `kinds` are the elements that list them; left out: those of outputs and derivatives.
    """
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    two = root.get("fmiVersion") == "2.0"
    key = "index" if two else "valueReference"
    variables = list(root.find("ModelVariables"))
    names = {
        str(k + 1) if two else v.get("valueReference"): v.get("name")
        for k, v in enumerate(variables)
    }
    now = ("Outputs/*", "Derivatives/*") if two else ("Output", "ContinuousStateDerivative")
    found = {}
    for element in kinds or now:
        for unknown in root.find("ModelStructure").findall(element):
            known = unknown.get("dependencies").split()
            said = unknown.get("dependenciesKind", "dependent " * len(known)).split()
            own = {names[k]: kind for k, kind in zip(known, said, strict=True)}
            found[names[unknown.get(key)]] = own
    return found


def what_moves(path, name):
    """By unknown and known: whether the unknown took another value wherever the known did."""
    kernel, model = fmu_kernel(name), catalogued_model(name)
    random = np.random.default_rng(12)
    inputs = [i for i in kernel.inputs if i.role != "internal"]
    states = [v.name for v in model.interface.states]
    unknowns = [o.name for o in kernel.outputs] + [d.name for d in model.interface.derivatives]
    moved = {u: set() for u in unknowns}
    probe = Host(path, exchange=True, begun=False)
    limited = "u_max" in {p.name for p in kernel.parameters}

    def value(nominal):
        return float(nominal * random.normal() * 10 ** random.uniform(-2, 1.5))

    def go(values):
        probe.fmu.reset()
        probe.begin(values)
        probe.update()

    for k in range(POINTS):
        start = {f"{s.name}_start": value(s.nominal) for s in kernel.states}
        if "v_start" in start and kernel.modes and k % 2:
            start["v_start"] = 0.0  # sticks
        drive = {i.name: value(i.nominal if i.name != "u" else 10.0) for i in inputs}
        go(start | drive)
        if limited and k % 2:  # within a hair of its limit, which anything may take it over
            go(start | drive | {"u_max": 1e6})
            near = max(abs(probe.get("u")[0]) * (1 + 1e-9), 1e-3)
            go(start | drive | {"u_max": near})
        at = probe.get(*states)
        before = probe.get(*unknowns)

        def moves(known, before=before):
            after = probe.get(*unknowns)
            for unknown, a, b in zip(unknowns, before, after, strict=True):
                if a != b:
                    moved[unknown].add(known)

        for j, (s, info) in enumerate(zip(states, kernel.states, strict=True)):
            other = [*at]
            other[j] = value(info.nominal)
            probe.set_states(other)
            moves(s)
        probe.set_states(at)
        for i in inputs:
            probe.set({i.name: value(i.nominal)})
            moves(i.name)
            probe.set({i.name: drive[i.name]})
        assert probe.get(*unknowns) == before
    probe.close()
    return moved


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_what_is_listed_moves_an_unknown_somewhere_and_nothing_else_ever_does(native, name):
    moved = what_moves(native(name), name)
    if "u_rate" in (i.name for i in fmu_kernel(name).inputs):
        for known in moved.values():
            if "u" in known:  # which u_rate moves within a step of co-simulation
                known.add("u_rate")
    three = {u: set(known) - {"time"} for u, known in listed(native(name, 3)).items()}
    assert three == moved
    assert {u: set(known) for u, known in listed(native(name)).items()} == moved


@pytest.mark.ci
@pytest.mark.parametrize("name", EVERY_COMPONENT)
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
        host = Host(native(name), values)
        seen.append([host.slopes([u], [k], [1.0]) for u, k in steady])
        host.close()
    assert all(row == seen[0] for row in seen)
    assert [0.0] not in seen[0]


def initially(path, fmi):
    """Names that each unknown is said to follow in initialization."""
    kinds = ("InitialUnknowns/*",) if fmi == 2 else ("InitialUnknown",)
    return {unknown: set(known) for unknown, known in listed(path, kinds).items()}


def what_moves_initially(path, points):
    """By unknown: inputs, parameters and start values that moved it in initialization mode."""
    probe = Host(path, exchange=True, begun=False)
    knowns = [v for v in probe.variables if v.causality in ("input", "parameter")]
    unknowns = list(initially(path, 2))
    moved = {u: set() for u in unknowns}
    random = np.random.default_rng(14)

    def other(v):
        if v.causality == "parameter" and not v.name.endswith("_start") and float(v.start):
            value = float(v.start) * 10 ** random.uniform(-0.5, 0.5)
        else:
            value = float(v.nominal) * random.normal() * 10 ** random.uniform(-2, 1.5)
        low, high = float(v.min or "-inf"), float(v.max or "inf")
        return float(np.clip(value, low, high))

    for k in range(points):
        probe.fmu.reset()
        probe.fmu.setupExperiment(startTime=0.0)
        probe.fmu.enterInitializationMode()
        values = {v.name: 0.0 if v.name == "v_start" and k % 3 == 1 else other(v) for v in knowns}
        probe.set(values)
        before = probe.get(*unknowns)
        for v in knowns:
            probe.set({v.name: other(v)})
            for unknown, a, b in zip(unknowns, before, probe.get(*unknowns), strict=True):
                if a != b:
                    moved[unknown].add(v.name)
            probe.set({v.name: values[v.name]})
    probe.close()
    return moved


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_what_is_listed_for_initialization_moves_the_unknown_and_nothing_else(fmus, native, name):
    """Outputs, states and derivatives, each with a list, the same in both versions and builds."""
    two, three = initially(native(name), 2), initially(native(name, 3), 3)
    assert {u: known - {"time"} for u, known in three.items()} == two
    model = catalogued_model(name)
    outputs = {o.name for o in model.kernel.outputs}
    own = [*model.interface.states, *model.interface.derivatives]
    assert set(two) == outputs | {v.name for v in own}
    assert initially(fmus[name], 2) == {o: two[o] for o in outputs}
    exactly = name in EXACTLY
    moved = what_moves_initially(native(name), 30 if exactly else 4)
    for unknown, known in moved.items():
        assert known <= two[unknown], unknown
    if name == "plant":  # within a step of co-simulation only, and what the others hide
        two["der(i)"] -= {"u_rate", "voltage_limit", "current_limit", "current_limit_time"}
    assert moved == two or not exactly


@pytest.mark.ci
def test_jumps_modes_and_what_chooses_the_first_mode_are_listed(written):
    """A jump has no slope, but what it depends on is listed; of modes, whatever one depends on."""
    a, b, s, r, gain, heard, t = (symbol(n) for n in ("a", "b", "s", "r", "gain", "heard", "t"))
    tau = Parameter("tau", 0.01, "s", "delay", "here")
    part = Component(
        "part",
        "two modes, one of which begins where b says so and sets r",
        parameters=(Parameter("gain", 2.0, "1", "gain", "here"),),
        inputs=(Input("a", "1", "a"), Input("b", "1", "b")),
        states=(State("s", "1", "s", gain * a), State("r", "1", "r", -r)),
        outputs=(
            Output("same", "1", "the same in both", s),
            Output("other", "1", "differs", s),
            Output("set", "1", "r, which is set", r),
            Output("late", "1", "time and s", s + t),
            Output("jump", "1", "which side b is on", sp.Heaviside(b)),
        ),
        modes=(
            Mode("one", events=(Event("go", b - 0.5, 1, {"r": a}, "two"),)),
            Mode("two", derivatives={"s": -s}, outputs={"other": 2 * s}),
        ),
    )
    path = written(part, "native-2")
    found = initially(path, 2)
    assert found == {
        "same": {"s_start"},
        "other": {"s_start", "b"},
        "set": {"r_start", "a", "b"},
        "late": {"s_start"},
        "jump": {"b"},
        "der(same)": {"gain", "a", "s_start", "b"},
        "der(set)": {"r_start", "a", "b"},
    }
    assert what_moves_initially(path, 20) == found
    three = written(part, "native-3")
    assert initially(three, 3)["late"] == {"s_start", "time"}
    for made, more in ((path, set()), (three, {"time"})):
        assert validate_fmu(str(made)) == []
        now = {u: set(known) for u, known in listed(made).items()}
        assert now["der(same)"] == {"a", "same"}
        assert now["jump"] == {"b"}
        assert now["late"] == {"same"} | more
    delayed = Component(
        "delayed",
        "an input, late",
        parameters=(tau,),
        inputs=(Input("a", "1", "a"),),
        outputs=(Output("late", "1", "a, late", 2 * heard),),
        delays=(Delay("heard", a, symbol("tau"), start=0.25),),
    )
    assert initially(written(delayed, "native-2"), 2) == {"late": set()}
