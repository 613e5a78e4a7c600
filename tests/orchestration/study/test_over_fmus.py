"""A run of a study again over FMUs: what the master says of it."""

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.fmus.catalogue import fmu
from ballscrew.orchestration.study.loop import StudyLoop
from ballscrew.orchestration.study.over_fmus import check_over_fmus
from ballscrew.orchestration.study.plan import Duty
from ballscrew.orchestration.whole_loop import loop_kernel

DUTY = Duty("there", "move:distance=0.005,speed=0.1,start=0,dwell=0.1,back=0", 0.2)


@pytest.mark.parametrize(
    ("controller", "verdict", "reason"),
    [
        ("pid_sampled", "trusted", "moved no output by more than 0 %"),
        ("nctf_sampled", "trusted", "moved no output by more than 0 %"),
        ("nctf", "trusted", "moved no output by more than"),
    ],
)
def test_a_loop_that_converges_is_trusted_and_agrees(controller, verdict, reason):
    loop = StudyLoop(loop_kernel("plant", controller))
    found = check_over_fmus(loop, (str(fmu("plant")), str(fmu(controller))), {}, DUTY, 1e-6)
    assert found.coupling == verdict
    assert reason in found.reason
    assert found.agrees


def test_a_continuous_loop_may_differ_by_what_the_grid_takes_from_a_curved_set_point():
    """5e-9 m in ramps of 1 ms; the master, which converges, cannot know of them."""
    duty = Duty("sine", "sine:amplitude=1e-3,frequency=2,duration=0.5", 0.5)
    loop = StudyLoop(loop_kernel("plant", "p_pi"))
    found = check_over_fmus(loop, (str(fmu("plant")), str(fmu("p_pi"))), {}, duty, 1e-6)
    assert found.coupling == "trusted"
    assert found.agrees
    assert found.allowed < 5 * found.apart  # which would find what is wrong by more
    assert json.loads(json.dumps(asdict(found))) == asdict(found)  # as it is kept for --resume


def test_a_loop_without_a_voltage_limit_that_diverges_is_not_converged():
    """nctf at a period of 1 ms; it bears 0.6 ms (`docs/stability.md`)."""
    controller = "nctf_sampled"
    loop = StudyLoop(loop_kernel("plant", controller))
    values = {"controller_sample_time": 1e-3}
    found = check_over_fmus(loop, (str(fmu("plant")), str(fmu(controller))), values, DUTY, 1e-6)
    assert found.coupling == "not converged"
    assert "diverges" in found.reason


class OneCount:
    """A loop whose position is a count further where the solver's tolerance says so."""

    sampled = True
    kernel = SimpleNamespace(parameters=())

    def __init__(self, flips):
        self.flips = flips

    def run(self, values, reference, stop, tolerance):
        time = np.linspace(0.0, stop, 5)
        position = np.full(5, 1e-9 if self.flips(tolerance) else 0.0)
        return SimpleNamespace(time=time, position=position, stopped="")


@pytest.mark.parametrize(
    ("apart", "flips", "agrees"),
    [
        (1e-9, lambda tolerance: 3e-8 < tolerance < 5e-8, True),  # as a few tolerances do, too
        (1e-9, lambda tolerance: False, False),
        (2e-8, lambda tolerance: 3e-8 < tolerance < 5e-8, False),  # more than ten times as much
    ],
)
def test_a_count_that_few_tolerances_see_is_no_difference(monkeypatch, apart, flips, agrees):
    """Such runs were called different: one of eighty behind the encoder of `docs/swap-study.md`."""
    loop = OneCount(flips)

    def over_fmus(study):
        time = np.linspace(0.0, study.stop, 5)
        verdict = SimpleNamespace(word="trusted", reason="")
        return SimpleNamespace(
            run=SimpleNamespace(time=time, outputs={"x": np.full(5, apart)}, verdict=verdict)
        )

    monkeypatch.setattr("ballscrew.orchestration.study.over_fmus.run_study", over_fmus)
    assert check_over_fmus(loop, ("plant", "controller"), {}, DUTY, 1e-6).agrees is agrees
