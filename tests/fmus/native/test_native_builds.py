"""A native FMU and the pythonfmu build of the same component are one thing to a host."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import textwrap
import threading

import fmpy
import numpy as np
import pytest
from every_component import EVERY_COMPONENT
from fmpy.validation import validate_fmu
from fmu_host import opened

from ballscrew.fmus.catalogue import NAMES, component, fmu_kernel
from ballscrew.fmus.native.export import export_native, write_native
from ballscrew.fmus.native.sources import catalogued_model
from ballscrew.instruments import INSTRUMENTS
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.master import run_loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.solver.component import Component, Event, Input, Mode, Output, State, symbol
from ballscrew.solver.kernel import Model


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_fmpy_validates_without_a_message(native, name):
    assert validate_fmu(str(native(name))) == []


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_every_variable_of_the_twin_is_there_as_it_is_there(fmus, native, name):
    def table(path):
        variables = fmpy.read_model_description(str(path)).modelVariables
        fields = "valueReference type causality variability initial unit min max nominal start"
        return {
            v.name: [getattr(v, f) for f in fields.split()] + [v.description] for v in variables
        }

    twin, own = table(fmus[name]), table(native(name))
    assert {n: own[n] for n in twin} == twin
    more = set(own) - set(twin)
    assert len([n for n in more if n.startswith("der(")]) == len(fmu_kernel(name).states)


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_no_fmu_is_larger_than_a_hundred_kilobytes(native, name):
    assert native(name).stat().st_size < 100_000


def course(plant, controller, stop, **options):
    parts = FmuInstance(plant, "plant"), FmuInstance(controller, "controller")
    run = run_loop(*parts, Reference.constant(0.08), stop, 1e-3, **options)
    for part in parts:
        part.close()
    return run.outputs | run.commands


@pytest.mark.parametrize(
    ("plant", "controller"),
    [
        ("plant", "nctf"),
        ("plant", "iol"),
        ("plant", "pid_sampled"),
        ("plant_classical", "pid"),  # sticks and slides
    ],
)
def test_twins_agree_along_the_closed_loop(fmus, native, plant, controller):
    theirs = course(fmus[plant], fmus[controller], 2.0)
    ours = course(native(plant), native(controller), 2.0)
    for name, values in theirs.items():
        assert np.abs(ours[name] - values).max() <= 1e-9 * np.ptp(values), name


def test_a_native_plant_takes_the_place_of_its_twin_in_a_loop(fmus, native):
    mixed = course(native("plant"), fmus["iol"], 0.5)
    theirs = course(fmus["plant"], fmus["iol"], 0.5)
    for name, values in theirs.items():
        assert np.abs(mixed[name] - values).max() <= 1e-9 * np.ptp(values), name


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_twins_give_the_same_numbers_from_random_inputs(fmus, native, name):
    """The conformance suite holds pythonfmu's to the equations."""
    kernel = fmu_kernel(name)
    inputs = [i.name for i in kernel.inputs if i.role != "internal"]
    outputs = [o.name for o in kernel.outputs]
    tables = []
    for path in (fmus[name], native(name)):
        random = np.random.default_rng(4)
        slave, at = opened(path)
        table = []
        for k in range(50):
            values = random.normal(size=len(inputs))
            values *= [1e-3 if n[0] != "u" else 1.0 for n in inputs]
            slave.setReal([at[n] for n in inputs], list(values))
            slave.doStep(k * 1e-3, 1e-3)
            table.append(slave.getReal([at[n] for n in outputs]))
        slave.terminate()
        slave.freeInstance()
        tables.append(np.array(table))
    theirs, ours = tables
    assert (np.abs(ours - theirs).max(axis=0) <= 1e-9 * np.ptp(theirs, axis=0)).all()


def test_the_variational_twin_carries_tangents_and_sets_them_at_a_new_frame(tmp_path):
    from ballscrew.fmus.catalogue import fmu

    own = write_native(catalogued_model("plant", tangents=2), tmp_path / "v.fmu", 2).path
    assert validate_fmu(str(own)) == []
    seen = []
    for path in (fmu("plant", tangents=2), own):
        slave, vr = opened(path, {"u": 5.0})
        outputs = [r for n, r in sorted(vr.items()) if n.endswith(("_d1", "_d2", "integral"))]
        slave.doStep(0.0, 1e-3)
        slave.setReal([vr["x_d1_set"], vr["v_d2_set"], vr["tangent_frame"]], [0.5, 2.0, 1.0])
        rows = [slave.getReal([vr["x_d1"], vr["v_d2"], vr["x_d2"]])]
        slave.doStep(1e-3, 1e-3)
        seen.append([*rows, slave.getReal(outputs)])
        slave.terminate()
        slave.freeInstance()
    assert seen[0][0] == seen[1][0] == [0.5, 2.0, 0.0]
    assert seen[1][1] == pytest.approx(seen[0][1], rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_a_restored_or_deserialized_state_goes_on_bit_for_bit(native, name):
    slave, vr = opened(native(name))
    kernel = fmu_kernel(name)
    inputs = [vr[i.name] for i in kernel.inputs if i.role != "internal"]
    outputs = [vr[o.name] for o in kernel.outputs]
    values = np.random.default_rng(3).normal(size=(40, len(inputs))) * 1e-3

    def rows(chosen, start):
        table = []
        for k, row in enumerate(chosen):
            slave.setReal(inputs, list(row))
            slave.doStep(start + k * 1e-3, 1e-3)
            table.append(slave.getReal(outputs))
        return table

    rows(values[:20], 0.0)
    state = slave.getFMUstate()
    data = slave.serializeFMUstate(state)
    first = rows(values[20:], 0.02)
    slave.setFMUstate(state)
    assert rows(values[20:], 0.02) == first
    slave.freeFMUstate(state)
    again = slave.deSerializeFMUstate(data)
    slave.setFMUstate(again)
    assert rows(values[20:], 0.02) == first
    slave.terminate()
    slave.freeInstance()  # with a state that nobody freed


def python(code, *arguments):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
        env=os.environ,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_state_serialized_in_one_process_goes_on_in_another(native, tmp_path):
    code = """
        import sys, json, fmpy
        from pathlib import Path
        from fmpy.fmi2 import FMU2Slave
        description = fmpy.read_model_description(sys.argv[1])
        slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(sys.argv[1]),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        vr = {v.name: v.valueReference for v in description.modelVariables}
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.setReal([vr["u"]], [20.0])
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        file = Path(sys.argv[2])
        if file.exists():
            slave.setFMUstate(slave.deSerializeFMUstate(file.read_bytes()))
        else:
            for k in range(30):
                slave.doStep(k * 1e-3, 1e-3)
            file.write_bytes(slave.serializeFMUstate(slave.getFMUstate()))
        for k in range(30, 60):
            slave.doStep(k * 1e-3, 1e-3)
        print(json.dumps(slave.getReal([vr[n] for n in ("x", "v", "z", "i", "friction")])))
    """
    runs = [python(code, native("plant"), tmp_path / "state") for _ in range(2)]
    assert json.loads(runs[0]) == json.loads(runs[1])


def test_bytes_that_are_no_state_of_this_fmu_are_refused(native):
    slave, _ = opened(native("plant"))
    other, _ = opened(native("plant_lugre"))
    data = bytearray(slave.serializeFMUstate(slave.getFMUstate()))
    for bad in (data[:-1], bytes(len(data)), data[:99] + bytes([data[99] ^ 1]) + data[100:]):
        with pytest.raises(Exception, match="fmi2DeSerializeFMUstate"):
            slave.deSerializeFMUstate(bytes(bad))
    with pytest.raises(Exception, match="fmi2DeSerializeFMUstate"):
        other.deSerializeFMUstate(bytes(data))
    slave.setFMUstate(slave.deSerializeFMUstate(bytes(data)))
    slave.freeInstance()
    other.freeInstance()


def test_instances_in_threads_of_one_process_do_not_disturb_each_other(native):
    def one(voltage, seen):
        slave, vr = opened(native("plant"), {"u": voltage})
        for k in range(300):
            slave.doStep(k * 1e-3, 1e-3)
        seen[voltage] = slave.getReal([vr["x"], vr["z"]])
        slave.terminate()
        slave.freeInstance()

    alone, together = {}, {}
    voltages = [1.0 + k for k in range(16)]
    for voltage in voltages:
        one(voltage, alone)
    threads = [threading.Thread(target=one, args=(v, together)) for v in voltages]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone
    assert len({tuple(v) for v in alone.values()}) == len(voltages)


# -- model exchange --------------------------------------------------------------------------


def on_grid(course, name, steps):
    """Values at the milliseconds, before what happens there; fmpy adds rows at events."""
    grid = np.round(course["time"] * 1e3, 6)
    first = dict(zip(grid[::-1], course[name][::-1], strict=True))
    return np.array([first[float(k)] for k in range(steps + 1)])


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("plant")])
def test_model_exchange_under_cvode_agrees_with_the_equations(native, name):
    """Classical friction has events there: it slides, and sticks where the voltage is low."""
    voltage = np.array(
        [(0.0, 0.1), (0.1, 0.1), (0.1, 20.0), (0.3, 20.0), (0.3, 0.0), (0.5, 0.0)],
        dtype=[("time", float), ("u", float)],
    )
    course = fmpy.simulate_fmu(
        str(native(name)),
        fmi_type="ModelExchange",
        stop_time=0.5,
        output_interval=1e-4,  # fmpy allows CVODE 500 steps in each, and Maxwell-slip has corners
        relative_tolerance=1e-9,
        input=voltage,
        output=["x", "v", "i"],
    )
    model = Model(fmu_kernel(name))
    expected = []
    for a, b, u in ((0, 100, 0.1), (100, 300, 20.0), (300, 500, 0.0)):
        model.set_input("u", u)
        part = model.simulate(np.arange(a, b + 1) * 1e-3)
        expected.append(np.column_stack([part.outputs[n] for n in ("x", "v", "i")])[:-1])
    expected = np.vstack(expected)
    for k, signal in enumerate(("x", "v", "i")):
        error = np.abs(on_grid(course, signal, 500)[:-1] - expected[:, k]).max()
        assert error < 1e-5 * np.ptp(expected[:, k]), signal


def test_model_exchange_samples_when_the_sampled_controller_does(native):
    held = {}
    for kind in ("CoSimulation", "ModelExchange"):
        course = fmpy.simulate_fmu(
            str(native("pid_sampled")),
            fmi_type=kind,
            stop_time=0.05,
            output_interval=1e-3,
            start_values={"x_d": 0.08},
            output=["u"],
        )
        held[kind] = on_grid(course, "u", 50)
    # what is held before an instant is the same; the first row of model exchange has sampled
    assert held["ModelExchange"][1:].tolist() == held["CoSimulation"][1:].tolist()
    assert len(set(held["CoSimulation"])) > 5


@pytest.fixture(scope="module")
def bouncing(tmp_path_factory):
    """A ball that bounces, and a switch that watches an input either way."""
    height, speed, side, w = (symbol(n) for n in ("height", "speed", "side", "w"))
    ball = Component(
        "ball",
        "a ball",
        states=(
            State("height", "m", "height", speed, start=1.0),
            State("speed", "m/s", "speed", -9.81 + 0 * height),
            State("side", "1", "side", 0 * side),
        ),
        inputs=(Input("w", "1", "watched"),),
        outputs=(Output("h", "m", "height", height), Output("s", "1", "side", side)),
        modes=(
            Mode(
                "flies",
                events=(
                    Event("bounce", height, -1, {"speed": -0.8 * speed}),
                    Event("cross", height - 0.5 + 0 * w, 0, {"side": side + 1}),
                ),
            ),
        ),
    )
    return ball, export_native(ball, tmp_path_factory.mktemp("ball") / "ball.fmu").path


def test_events_of_all_kinds_happen_in_both_kinds_of_simulation(bouncing):
    from ballscrew.solver.codegen import generate

    ball, path = bouncing
    assert validate_fmu(str(path)) == []
    model = Model(generate(ball))
    truth = model.simulate(np.arange(1001) * 1e-3)
    for kind, tolerance in (("CoSimulation", 0.0), ("ModelExchange", 1e-5)):
        course = fmpy.simulate_fmu(
            str(path),
            fmi_type=kind,
            stop_time=1.0,
            output_interval=1e-3,
            relative_tolerance=1e-8 if kind == "CoSimulation" else 1e-9,
        )
        assert np.abs(on_grid(course, "h", 1000) - truth.outputs["h"]).max() <= tolerance
        assert course["s"][-1] == truth.outputs["s"][-1] == 3.0


# -- partial derivatives ---------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_directional_derivatives_are_the_partial_derivatives_of_the_equations(native, name):
    """Central differences in 40 digits of the symbolic equations are the oracle."""
    import mpmath
    import sympy as sp

    from ballscrew.fmus.export import with_law_ports

    kernel, part = fmu_kernel(name), with_law_ports(component(name))
    random = np.random.default_rng(5)
    signals = [i for i in kernel.inputs if i.role != "internal"]
    starts = {f"{s.name}_start": float(s.nominal * random.normal() * 3) for s in kernel.states}
    values = {i.name: float(random.normal()) * (1 if i.name[0] == "u" else 1e-3) for i in signals}
    slave, vr = opened(native(name), starts | values)
    mode = ""
    if part.modes:  # which mode it is in is seen in its outputs alone
        still = "stuck" if "stuck" in vr else "off"
        way = starts.get("v_start", slave.getReal([vr["u"]])[0])
        stuck = slave.getReal([vr["stuck"]])[0] if "stuck" in vr else way == 0
        mode = still if stuck else ("forward" if way > 0 else "backward")
    chosen = next((m for m in part.modes if m.name == mode), None)
    own = chosen.derivatives if chosen else {}
    equations = [own.get(s.name, e) for s, e in zip(kernel.states, part.derivatives, strict=True)]
    own = chosen.outputs if chosen else {}
    equations += [own.get(o.name, o.value) for o in part.all_outputs]
    fixed = {symbol(p.name): sp.Float(p.default, 40) for p in kernel.parameters}
    fixed |= {symbol(d.name): sp.Float(d.start, 40) for d in kernel.discrete}
    fixed |= {symbol("t"): sp.Integer(0), symbol("t_step"): sp.Integer(0)}
    names = [s.name for s in kernel.states] + [i.name for i in signals]
    at = [starts[f"{s.name}_start"] for s in kernel.states] + [values[i.name] for i in signals]
    nominal = [s.nominal for s in kernel.states] + [i.nominal for i in signals]
    model_states = catalogued_model(name).state_variables
    known = [v.reference for v in model_states] + [vr[i.name] for i in signals]
    derivatives = [v.reference for v in catalogued_model(name).derivatives]
    unknown = derivatives + [vr[o.name] for o in kernel.outputs]
    got = np.column_stack([slave.getDirectionalDerivative(unknown, [k], [1.0]) for k in known])
    f = sp.lambdify(
        [symbol(n) for n in names],
        [sp.sympify(e).xreplace(fixed) for e in equations],
        "mpmath",
    )
    with mpmath.workdps(40):
        exact = np.zeros(got.shape)
        for j in range(len(names)):
            h = mpmath.mpf(nominal[j]) * mpmath.mpf(10) ** -16
            up = [mpmath.mpf(v) for v in at]
            down = list(up)
            up[j], down[j] = up[j] + h, down[j] - h
            pairs = zip(f(*up), f(*down), strict=True)
            exact[:, j] = [float((a - b) / (2 * h)) for a, b in pairs]
    # a difference over 1e-16 of a nominal value has a round-off of 1e-24 of the row's terms
    scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-12
    assert np.max(np.abs(got - exact) / scale) < 1e-9
    # what an instrument gives is a staircase, or held: it has no slope
    assert (np.abs(exact).max() > 0) == (name not in INSTRUMENTS)
    seeds = random.normal(size=len(known))
    product = slave.getDirectionalDerivative(unknown, known, list(seeds))
    assert product == pytest.approx(got @ seeds, rel=1e-9, abs=1e-9 * np.abs(got @ seeds).max())
    slave.terminate()
    slave.freeInstance()


# -- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"R": -1.0}, "plant: parameter R = -1 ohm is out of its range"),
        ({"solver_tolerance": 1.0}, "plant: parameter solver_tolerance = 1 is out of its range"),
    ],
)
def test_a_parameter_out_of_range_fails_initialization_as_the_twin_says(fmus, native, values, said):
    for path in (fmus["plant"], native("plant")):
        plant = FmuInstance(path, "plant")
        with pytest.raises(StepFailed) as failed:
            plant.initialize(values, 1.0)
        plant.close()
        assert str(failed.value).startswith(said)


def test_what_is_not_a_number_is_refused_with_the_twin_s_words(fmus, native):
    said = []
    for path in (fmus["plant"], native("plant")):
        plant = FmuInstance(path, "plant")
        plant.initialize({}, 1.0)
        # the pythonfmu build takes the value, and says so in the step
        with contextlib.suppress(StepFailed):
            plant.writer(["u"])(np.array([np.nan]))
        with pytest.raises(StepFailed) as failed:
            plant.step(0.0, 1e-3)
        said.append(str(failed.value))
        plant.close()
    assert said == ["plant: u was set to nan, not a number"] * 2


def test_a_state_saved_before_a_failure_can_be_gone_on_from(native):
    plant = FmuInstance(native("plant"), "plant")
    plant.initialize({"u": 5.0}, 1.0)
    plant.step(0.0, 1e-3)
    saved, read = plant.save(), plant.reader(["x", "v", "i"])
    with pytest.raises(StepFailed):
        plant.writer(["u"])(np.array([np.inf]))
    assert plant.message()
    plant.restore(saved)
    assert plant.message() == ""
    plant.step(1e-3, 1e-3)
    again = FmuInstance(native("plant"), "plant")
    again.initialize({"u": 5.0}, 1.0)
    again.step(0.0, 1e-3)
    again.step(1e-3, 1e-3)
    assert read().tolist() == again.reader(["x", "v", "i"])().tolist()


def test_the_law_wired_or_not_is_the_law_of_the_twin(fmus, native):
    """Corrections roll back, so that they also prove states that are saved."""
    options = {"coupling": Coupling.INTERFACE_JACOBIAN, "corrections": 1}
    theirs = course(fmus["plant"], fmus["iol"], 0.5, **options)
    ours = course(native("plant"), native("iol"), 0.5, **options)
    for name, values in theirs.items():
        assert np.abs(ours[name] - values).max() <= 1e-9 * np.ptp(values), name
