"""Runs that judge are played by compiled code, and say to the last bit what the FMUs say."""

import math
from dataclasses import asdict

import numpy as np
import pytest

from ballscrew.fmus.catalogue import fmu
from ballscrew.fmus.export import export
from ballscrew.orchestration import master
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.played import Played, reopened_to_judge
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.solver.component import Component, Input, Output, State, symbol


@pytest.mark.parametrize(
    ("controller", "step", "stop", "given"),
    [
        ("iol", 1e-3, 0.3, {}),
        ("nctf", 2e-4, 0.1, {}),
        ("relay", 1e-3, 0.3, {}),  # it has events
        ("pid_sampled", 1e-3, 0.3, {}),
        ("p_pi", 1e-3, 0.3, {"coupling": Coupling.JACOBI}),
        ("pid", 1e-3, 0.3, {"adaptive": True}),
    ],
)
def test_the_verdict_is_that_of_the_fmus_to_the_last_bit(
    controller, step, stop, given, monkeypatch
):
    asked = Loop(controller, stop=stop, step=step, **given)
    played = run_closed_loop(asked).run
    monkeypatch.setattr(master, "reopened_to_judge", FmuInstance.reopened)
    through_fmus = run_closed_loop(asked).run
    assert repr(played.verdict) == repr(through_fmus.verdict)
    assert asdict(played).keys() == asdict(through_fmus).keys()
    for name, values in through_fmus.outputs.items():
        np.testing.assert_array_equal(played.outputs[name], values)


def test_a_run_with_its_verdict_steps_its_two_fmus_alone(monkeypatch):
    opened, played = [], []
    open_fmu, play = FmuInstance.__init__, Played.__init__
    monkeypatch.setattr(FmuInstance, "__init__", lambda *a: opened.append(a) or open_fmu(*a))
    monkeypatch.setattr(Played, "__init__", lambda *a: played.append(a) or play(*a))
    verdict = run_closed_loop(Loop("iol", stop=0.3, step=1e-3)).run.verdict
    assert "a half and a quarter of the step" in verdict.reason
    assert len(opened) == len(played) + 2


@pytest.fixture(scope="module")
def blow_up(tmp_path_factory):
    """An FMU whose state diverges at t = 1 / u."""
    x, u = symbol("x"), symbol("u")
    part = Component(
        "blow_up",
        "x' = u x^2",
        inputs=(Input("u", "1", "command", start=1.0),),
        states=(State("x", "1", "state", u * x * x, start=1.0),),
        outputs=(Output("x", "1", "state", x),),
    )
    return export(part, tmp_path_factory.mktemp("fmus") / "blow_up.fmu")


@pytest.mark.parametrize("wrong", [None, math.nan])
def test_a_failure_is_told_as_the_fmu_itself_tells_it(blow_up, wrong):
    told = []
    first = FmuInstance(blow_up, "part")
    for part in (first, reopened_to_judge(first)):
        part.initialize({}, 4.0)
        write, read = part.writer(["u"]), part.reader(["x"])
        part.step(0.0, 0.5)
        state = part.save()
        part.step(0.5, 0.25)
        part.restore(state)
        part.release(state)
        told.append(read().tolist())
        if wrong is not None:
            write(np.array([wrong]))
        with pytest.raises(StepFailed) as failed:
            part.step(0.5, 1.0)
        told.append((str(failed.value), failed.value.advice))
        part.close()
    assert told[0] == told[2] == pytest.approx([2.0], rel=1e-6)
    assert told[1] == told[3]
    assert "part" in told[1][0]


@pytest.mark.parametrize("name", ["plant", "pid_sampled", "relay"])
def test_only_readable_fmus_of_this_version_are_played(name, tmp_path):
    usual = FmuInstance(fmu(name), name)
    played = reopened_to_judge(usual)
    assert isinstance(played._fmi, Played)
    copy = tmp_path / "changed.fmu"
    copy.write_bytes(fmu(name).read_bytes() + b"\0")
    changed = FmuInstance(copy, name)
    other = reopened_to_judge(changed)
    assert not isinstance(other._fmi, Played)
    for part in (usual, played, changed, other):
        part.close()
