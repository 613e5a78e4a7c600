"""A run of a study repeated over FMUs: what the master says of it."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study.figures import figures_of
from ballscrew.orchestration.study.loop import StudyLoop, check_over_fmus
from ballscrew.orchestration.study.plan import Duty

pytestmark = pytest.mark.ci

DUTY = Duty("there", "move:distance=0.005,speed=0.1,start=0,dwell=0.1,back=0", 0.2)


def table_of(loop, values, duty):
    """What a study says of this run."""
    course = loop.run(values, duty.signal(), duty.stop, 1e-6)
    return asdict(figures_of(course, count=2e-6, limit=36.0))


def checked(loop, controller, values, duty):
    fmus = str(fmu("plant")), str(fmu(controller))
    return check_over_fmus(loop, fmus, values, duty, 1e-6, table_of(loop, values, duty))


@pytest.mark.parametrize(
    "wrong",
    [{"rms_error": 1.001}, {"peak_error": 0.999}, {"rms_error": np.nan, "peak_error": np.nan}],
)
def test_a_table_that_says_other_figures_than_the_run_over_fmus_disagrees(wrong):
    loop = StudyLoop(loop_kernel("plant", "pid_sampled"))
    table = table_of(loop, {}, DUTY)
    other = table | {name: table[name] * factor for name, factor in wrong.items()}
    fmus = str(fmu("plant")), str(fmu("pid_sampled"))
    assert check_over_fmus(loop, fmus, {}, DUTY, 1e-6, table).agrees
    assert not check_over_fmus(loop, fmus, {}, DUTY, 1e-6, other).agrees


@pytest.mark.parametrize(
    ("controller", "values", "most"),
    [
        ("pid_sampled", {}, 1e-11),  # m
        ("nctf+sampled", {"controller_sample_time": 5e-5}, 1e-7),
        ("nctf", {}, 1e-6),
    ],
)
def test_a_loop_that_converges_is_trusted_and_agrees(controller, values, most):
    loop = StudyLoop(loop_kernel("plant", controller))
    found = checked(loop, controller, values, DUTY)
    assert found.coupling == "trusted"
    assert found.agrees
    assert found.allowed < most


class OneCount:
    """A loop whose position is a count further where the solver's tolerance says so."""

    parameters = ()

    def __init__(self, flips):
        self.flips = flips

    def run(self, values, reference, stop, tolerance):
        time = np.linspace(0.0, stop, 5)
        position = np.full(5, 1e-9 if self.flips(tolerance) else 0.0)
        return SimpleNamespace(time=time, position=position, reference=0 * time, stopped="")


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
        verdict = SimpleNamespace(word="trusted", reason="", error_estimate={"x": 0.0})
        return SimpleNamespace(
            run=SimpleNamespace(time=time, outputs={"x": np.full(5, apart)}, verdict=verdict)
        )

    monkeypatch.setattr("ballscrew.orchestration.study.loop.run_closed_loop", over_fmus)
    table = {"rms_error": 0.0, "peak_error": 0.0, "failed": 0.0}
    assert check_over_fmus(loop, ("plant", "pid"), {}, DUTY, 1e-6, table).agrees is agrees
