"""Readable and native FMUs, of FMI 2 and 3, are one thing to a host: held to the same demands."""

import contextlib
import json
from itertools import pairwise

import numpy as np
import pytest
from any_fmu import KINDS, NATIVE, Host, python
from every_component import EVERY_COMPONENT
from thesis_axis import axis_under

from ballscrew import Component, Output, State, symbol
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

every_kind = pytest.mark.parametrize("kind", KINDS)
few_kinds = pytest.mark.parametrize(
    "kind", ["readable", "native-2", pytest.param("native-3", marks=pytest.mark.ci)]
)
every_component = pytest.mark.parametrize("name", EVERY_COMPONENT)


def ports(name):
    """Names of inputs and outputs."""
    kernel = fmu_kernel(name)
    inputs = [i.name for i in kernel.inputs if i.role != "internal"]
    return inputs, [o.name for o in kernel.outputs]


def driven(host, name, steps, first=0):
    """Outputs after steps of a millisecond with drawn inputs, which begin with step `first`."""
    inputs, outputs = ports(name)
    rows = []
    for k in range(first, first + steps):
        values = np.random.default_rng(k).normal(size=len(inputs))
        values *= [1.0 if n[0] == "u" else 1e-3 for n in inputs]
        host.set(dict(zip(inputs, values, strict=True)))
        host.step(k * 1e-3, 1e-3)
        rows.append(host.get(*outputs))
    return np.array(rows)


# -- numbers -----------------------------------------------------------------------------------


@every_kind
@every_component
def test_outputs_under_random_inputs_are_those_of_the_equations(made, name, kind):
    kernel = fmu_kernel(name)
    inputs, outputs = ports(name)
    # tight, since round-off decides on which side of a bend of the law a step ends
    host = Host(made(name, kind), {"solver_tolerance": 1e-11} if kernel.states else {})
    found = driven(host, name, 20)
    host.close()
    model = Model(kernel, tolerance=1e-11)
    expected = []
    for k in range(20):
        values = np.random.default_rng(k).normal(size=len(inputs))
        for n, value in zip(inputs, values, strict=True):
            model.set_input(n, value * (1.0 if n[0] == "u" else 1e-3))
        for i in kernel.inputs:
            if i.role == "internal":
                model.set_input(i.name, k * 1e-3)
        samples = round(1e-3 / model.sample_time) if kernel.sample_time else 1
        times = 1e-3 * (k + np.arange(samples + 1) / samples)
        for begin, end in pairwise(times):
            if kernel.sample_time:
                model.sample(begin)
            model.advance(begin, end)
        y = model.outputs(times[-1], model.x)
        expected.append([y[n] for n in outputs])
    span = np.ptp(expected, axis=0)
    assert (np.abs(found - expected).max(axis=0) <= 1e-9 * span + 1e-12).all()
    assert span.max() > 0


@every_kind
def test_the_axis_alone_moves_as_the_equations_of_the_thesis_do_in_scipy(made, kind):
    times = np.arange(1, 101) * 1e-3
    truth = axis_under(5.0, times)[:, :4]
    for steps in ([1], [2], [0.5, 1.5]):  # equal and unequal ones
        host = Host(made("plant", kind), {"u": 5.0, "solver_tolerance": 1e-11})
        t, rows = 0, []
        for h in steps * (100 // round(sum(steps))):
            host.step(t * 1e-3, h * 1e-3)
            t += h
            if t == round(t):
                rows.append(host.get("x", "v", "z", "i"))
        host.close()
        every = 100 // len(rows)
        error = np.abs(rows - truth[every - 1 :: every]).max(axis=0)
        assert (error <= 3e-9 * np.ptp(truth, axis=0)).all()
    assert np.ptp(truth[:, 0]) > 1e-3


# -- saved states ------------------------------------------------------------------------------


@every_kind
@every_component
def test_a_state_restored_or_deserialized_and_a_reset_instance_go_on_bit_for_bit(made, name, kind):
    host = Host(made(name, kind))
    begin = driven(host, name, 10).tolist()
    state = host.fmu.getFMUState()
    data = bytes(host.fmu.serializeFMUState(state))
    first = driven(host, name, 10, 10).tolist()
    host.fmu.setFMUState(state)
    assert driven(host, name, 10, 10).tolist() == first
    host.fmu.freeFMUState(state)
    host.fmu.setFMUState(host.fmu.deserializeFMUState(data))  # which nobody frees
    assert driven(host, name, 10, 10).tolist() == first
    host.fmu.reset()
    host.begin()
    assert driven(host, name, 10).tolist() == begin
    host.fmu.terminate()
    host.close()


@pytest.mark.parametrize(
    "kind", [k if k == "native-2" else pytest.param(k, marks=pytest.mark.ci) for k in KINDS]
)
def test_a_state_serialized_in_one_process_goes_on_in_another(made, tmp_path, kind):
    code = """
        import json
        from pathlib import Path
        from any_fmu import Host
        host, file = Host(sys.argv[1], {"u": 20.0}), Path(sys.argv[2])
        if file.exists():
            host.fmu.setFMUState(host.fmu.deserializeFMUState(file.read_bytes()))
        else:
            for k in range(30):
                host.step(k * 1e-3, 1e-3)
            file.write_bytes(bytes(host.fmu.serializeFMUState(host.fmu.getFMUState())))
        for k in range(30, 60):
            host.step(k * 1e-3, 1e-3)
        print(json.dumps(host.get("x", "v", "z", "i")))
    """
    runs = [json.loads(python(code, made("plant", kind), tmp_path / "state")) for _ in range(2)]
    assert runs[0] == runs[1]


@pytest.mark.parametrize("kind", NATIVE)
def test_bytes_that_are_no_state_of_this_fmu_are_refused(made, kind):
    host, other = Host(made("plant", kind)), Host(made("plant_classical", kind))
    exchanging = Host(made("plant", kind), exchange=True)
    data = bytearray(host.fmu.serializeFMUState(host.fmu.getFMUState()))
    for bad in (data[:-1], bytes(len(data)), data[:99] + bytes([data[99] ^ 1]) + data[100:]):
        with pytest.raises(Exception, match="erializeFMU"):
            host.fmu.deserializeFMUState(bytes(bad))
        assert "no serialized state of this FMU" in host.heard[-1]
    for stranger in (other, exchanging):
        with pytest.raises(Exception, match="erializeFMU"):
            stranger.fmu.deserializeFMUState(bytes(data))
    host.fmu.setFMUState(host.fmu.deserializeFMUState(bytes(data)))
    for one in (host, other, exchanging):
        one.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_a_state_saved_before_a_failure_can_be_gone_on_from(made, kind):
    host, again = (Host(made("plant", kind), {"u": 5.0}) for _ in range(2))
    for one in (host, again):
        one.step(0.0, 1e-3)
    saved = host.fmu.getFMUState()
    with pytest.raises(Exception, match="fmi"):
        host.set({"u": np.inf})
    assert host.message() == "instance: u was set to inf, not a number"
    with pytest.raises(Exception, match="DoStep"):
        host.step(1e-3, 1e-3)
    host.fmu.setFMUState(saved)
    assert host.message() == ""
    for one in (host, again):
        one.step(1e-3, 1e-3)
    assert host.get("x", "v", "i") == again.get("x", "v", "i")
    host.close()
    again.close()


# -- parameters, tolerance and errors ----------------------------------------------------------


@every_kind
def test_the_host_s_tolerance_replaces_the_parameter(made, kind):
    def begun(given):
        host = Host(made("plant", kind), begun=False)
        host.begin({"solver_tolerance": 1e-9}, given)
        (value,) = host.get("solver_tolerance")
        host.close()
        return value

    assert [begun(given) for given in (None, 0.0, 1e-4)] == [1e-9, 1e-9, 1e-4]


@every_kind
def test_a_parameter_is_taken_at_its_limit_and_refused_with_a_text_beyond_it(made, kind):
    path = made("plant", kind)
    low = next(float(v.min) for v in Host(path).variables if v.name == "Fc")
    Host(path, {"Fc": low}).close()
    instance = FmuInstance(path, "axis")
    with pytest.raises(StepFailed) as failed:
        instance.initialize({"Fc": low * (1 - 1e-15)}, 1.0)
    instance.close()
    said = f"axis: parameter Fc = {low:g} N is out of its range [{low:g}, inf]"
    assert str(failed.value) == said


@every_kind
def test_what_is_not_a_number_fails_the_step_with_the_same_words(made, kind):
    plant = FmuInstance(made("plant", kind), "plant")
    plant.initialize({}, 1.0)
    with contextlib.suppress(StepFailed):  # a readable one says so in the step only
        plant.writer(["u"])(np.array([np.nan]))
    with pytest.raises(StepFailed, match=r"^plant: u was set to nan, not a number$"):
        plant.step(0.0, 1e-3)
    plant.close()


@few_kinds
def test_a_solution_that_leaves_every_bound_fails_with_a_text(written, kind):
    x = symbol("x")
    blow_up = Component(
        "blow_up",
        "x' = x^2",
        states=(State("x", "1", "state", x**2, start=1.0),),
        outputs=(Output("y", "1", "output", x),),
    )
    host = Host(written(blow_up, kind))
    host.step(0.0, 0.5)
    assert host.get("y") == pytest.approx([2.0], rel=1e-7)
    with pytest.raises(Exception, match="DoStep failed"):
        host.step(0.5, 1.0)
    assert host.message() == (
        "instance: the internal step became too small at t = 1 s; the solution diverges"
    )
    host.close()


# -- variables taken for another type than they are ----------------------------------------------

NUMBER_OF_NONE = 4_000_000
WRONG = [
    ("getReal", ["x", "message"], "message is a String, not a number"),
    ("getReal", [NUMBER_OF_NONE], f"no variable has the value reference {NUMBER_OF_NONE}"),
    ("getReal", [0], "no variable has the value reference 0"),
    ("getInteger", ["x"], "there are none"),
    ("getBoolean", ["x"], "there are none"),
    ("getString", ["x"], "no String has the value reference"),
    ("setReal", ["message"], "message cannot be set"),
    ("setReal", [NUMBER_OF_NONE], f"no variable has the value reference {NUMBER_OF_NONE}"),
    ("setInteger", ["u"], "there are none"),
    ("setBoolean", ["u"], "there are none"),
    ("setString", ["message"], "there are none"),
]


@every_kind
def test_a_variable_taken_for_another_type_is_refused_in_words_and_moves_nothing(made, kind):
    """pythonfmu's getters have no status, so that the refusal comes with the next step."""
    for name, variables, said in WRONG:
        host = Host(made("plant", kind), {"u": 20.0}, name="axis")
        host.step(0.0, 1e-3)
        before = host.get("x", "v")
        if kind == "native-3":
            name = name.replace("Real", "Float64").replace("Integer", "Int32")
        given = [[host.at.get(n, n) for n in variables]]
        given += [["well" if "String" in name else 1]] * name.startswith("set")
        if kind == "readable":
            got = getattr(host.fmu, name)(*given)
            assert name != "getReal" or np.isnan(got[-1])
            with pytest.raises(Exception, match="fmi2DoStep"):
                host.step(1e-3, 1e-3)
            assert said in host.message()
        else:
            with pytest.raises(Exception, match=f"fmi{host.version}"):
                getattr(host.fmu, name)(*given)
            assert said in host.heard[-1]
            assert host.get("x", "v") == before
            host.step(1e-3, 1e-3)
            assert host.message() == ""
        host.close()
