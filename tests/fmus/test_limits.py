"""Limits of FMUs, exactly where they are: steps, samples, times, sizes, and calls out of turn."""

import math
import re

import numpy as np
import pytest
from any_fmu import KINDS, NATIVE, Host

from ballscrew import Component, DiscreteState, Input, Output, Parameter, State, symbol
from ballscrew.orchestration.loop.catalogue import fmu_kernel

COUNTER = Component(
    "counter",
    "counts samples",
    inputs=(Input("u", "1", "not counted"),),
    outputs=(Output("n", "1", "samples taken", symbol("n")),),
    discrete=(DiscreteState("n", "1", "samples", symbol("n") + 1),),
    sample_time=Parameter("period", 1.0, "s", "period", "made up", minimum=0.0),
)
FAST = Component(
    "fast",
    "an oscillator of 1e5 rad/s",
    states=(
        State("a", "1", "angle", symbol("b"), start=1.0),
        State("b", "1/s", "rate", -1e10 * symbol("a")),
    ),
    outputs=(Output("a", "1", "angle", symbol("a")),),
)


def counted(path, step, start=0.0, parts=1):
    """Samples that one step has taken, or that many equal parts of it."""
    host = Host(path, begun=False)
    host.begin(start=start)
    for k in range(parts):
        host.step(start + step * k / parts, step / parts)
    (n,) = host.get("n")
    host.close()
    return n


@pytest.mark.parametrize("kind", KINDS)
def test_a_sample_is_due_within_a_billionth_of_the_period(written, kind):
    path = written(COUNTER, kind)
    assert counted(path, 1.0) == 1.0
    assert counted(path, 1.0 + 0.5e-9) == 1.0  # the next one is for the next step
    assert counted(path, 1.0 + 2e-9) == 2.0
    assert counted(path, 0.1, start=1.0 + 0.5e-9) == 1.0
    assert counted(path, 0.1, start=1.0 + 2e-9) == 0.0
    for parts in (1, 2, 100):
        assert counted(path, 2.5, start=2.5, parts=parts) == 2.0  # at 3 and 4 s


@pytest.mark.parametrize("kind", NATIVE)
def test_a_step_holds_a_million_samples_and_no_more(written, kind):
    assert counted(written(COUNTER, kind), 999_999.5) == 1e6
    assert counted(written(COUNTER, kind), 1.0, start=4.4e15) == 1.0
    for step, start in ((1e6, 0.0), (1.0, 4.6e15)):
        host = Host(written(COUNTER, kind), begun=False)
        host.begin(start=start)
        with pytest.raises(Exception, match="DoStep"):
            host.step(start, step)
        said = f"instance: a step from t = {start:.9g} s by {step:.9g} s holds too many sample"
        assert host.message().startswith(said)
        host.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_model_exchange_is_told_the_next_sample_and_takes_all_that_are_due(written, kind):
    host = Host(written(COUNTER, kind), exchange=True)

    def update(t):
        """Samples taken until then, and the time of the next."""
        host.fmu.setTime(t)
        three = host.version == 3
        *_, known, after = (
            host.fmu.updateDiscreteStates if three else host.fmu.newDiscreteStates
        )()
        assert known
        return [*host.get("n"), after]

    assert update(0.0) == [1.0, 1.0]
    assert update(1.0 - 2e-9) == [1.0, 1.0]
    assert update(1.0 - 0.5e-9) == [2.0, 2.0]
    assert update(7.5) == [8.0, 8.0]
    with pytest.raises(Exception, match="DiscreteStates"):
        update(2e6)
    assert host.message() == "instance: too many sample instants are due at t = 2000000 s"
    host.close()


@pytest.mark.parametrize("period", [-1e-3, 0.0, 1e-300])
def test_a_period_that_makes_no_sense_ends_in_an_error_and_not_in_a_loop(made, period):
    """In model exchange the host may go on after initialization has failed."""
    host = Host(made("pid_sampled", "native-2"), exchange=True, begun=False)
    with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
        host.begin({"sample_time": period})
    with pytest.raises(Exception, match="fmi2NewDiscreteStates"):
        host.update()
    host.close()


@pytest.mark.parametrize("kind", KINDS[:2])
def test_two_hundred_thousand_internal_steps_are_the_most_in_a_step(written, kind):
    host = Host(written(FAST, kind))
    host.step(0.0, 1e-3)
    assert host.get("a") == pytest.approx([math.cos(100.0)], abs=1e-4)
    with pytest.raises(Exception, match="DoStep"):
        host.step(1e-3, 1e3)
    said = "instance: 200000 internal steps were not enough at t = "
    assert host.message().startswith(said)
    host.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_without_length_or_end_fails(made, kind):
    for t, step in ((0.0, 0.0), (0.0, -1e-3), (0.0, math.nan), (0.0, math.inf)):
        host = Host(made("plant", kind))
        with pytest.raises(Exception, match="DoStep"):
            host.step(t, step)
        said = rf"instance: a step from t = 0(\.0)? s by {step:g}(\.0)? s is invalid"
        assert re.fullmatch(said, host.message())
        host.close()


IN_TURN = {  # phases that allow each call: I before, N in initialization, E event, C continuous
    "enterInitializationMode": "I",
    "exitInitializationMode": "N",
    "enterEventMode": "EC",
    "enterContinuousTimeMode": "E",
    "setTime": "EC",
    "update": "E",
    "completedIntegratorStep": "C",
    "terminate": "EC",
    "getContinuousStates": "NECT",
    "getNominalsOfContinuousStates": "INECT",
    "reset": "INECT",
}
BEFORE = {
    "I": [],
    "N": ["enterInitializationMode"],
    "E": ["enterInitializationMode", "exitInitializationMode"],
}
BEFORE["C"] = [*BEFORE["E"], "enterContinuousTimeMode"]
BEFORE["T"] = [*BEFORE["E"], "terminate"]


@pytest.mark.parametrize("kind", NATIVE)
def test_a_call_out_of_turn_is_refused_in_words(made, kind):
    def call(host, name):
        if name == "update":
            host.update()
        elif name.startswith("get"):
            host.array(name, 4)
        else:
            getattr(host.fmu, name)(*[0.5] * (name == "setTime"))

    for phase, calls in BEFORE.items():
        for name, allowed in IN_TURN.items():
            host = Host(made("plant", kind), exchange=True, begun=False)
            for earlier in calls:
                call(host, earlier)
            if phase in allowed:
                call(host, name)
                assert host.heard == []
            else:
                with pytest.raises(Exception, match=f"fmi{host.version}"):
                    call(host, name)
                assert "where it is not allowed" in host.heard[-1]
            host.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_a_step_of_co_simulation_belongs_between_initialization_and_the_end(made, kind):
    host = Host(made("plant", kind), {"u": 5.0}, name="x" * 300)
    other = Host(made("plant", kind))
    fmi = f"fmi{host.version}"
    host.step(0.0, 1e-3)
    before = host.get("x", "v")
    for call, said in (
        (lambda: host.set({"R": 1.0}), "parameter R cannot be set any more; set it before"),
        (lambda: host.set({"x": 1.0}), "x cannot be set; it is not an input or a parameter"),
        (host.fmu.enterInitializationMode, f"{fmi}EnterInitializationMode was called between"),
        (host.fmu.exitInitializationMode, f"{fmi}ExitInitializationMode was called between"),
        (
            lambda: host.fmu.setFMUState(other.fmu.getFMUState()),
            "this is no saved state of this instance",
        ),
    ):
        with pytest.raises(Exception, match=fmi):
            call()
        assert host.heard[-1].startswith("x" * 200 + f": {said}")
    assert host.get("x", "v") == before
    assert host.message() == ""
    host.step(1e-3, 1e-3)
    host.fmu.terminate()
    with pytest.raises(Exception, match=fmi):
        host.step(2e-3, 1e-3)
    assert f"{fmi}DoStep was called after the end" in host.heard[-1]
    host.close()
    other.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_numbers_and_sizes_that_make_no_sense_are_refused_in_words(made, kind):
    host = Host(made("plant", kind), exchange=True)
    assert host.array("getNominalsOfContinuousStates", 4).tolist() == [
        s.nominal for s in fmu_kernel("plant").states
    ]
    with pytest.raises(Exception, match="GetContinuousStates"):
        host.array("getContinuousStates", 3)
    assert host.heard[-1] == "instance: 3 states were asked for, there are 4"
    with pytest.raises(Exception, match="SetTime"):
        host.fmu.setTime(np.nan)
    assert host.heard[-1] == "instance: the time was set to nan, not a number"
    host.close()
    host = Host(made("plant", kind), begun=False)
    with pytest.raises(Exception, match=f"fmi{host.version}"):
        host.begin(start=np.inf)
    assert "the start time inf and the tolerance 0 make no sense" in host.heard[-1]
    host.close()
