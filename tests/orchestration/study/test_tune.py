"""Gains of one controller for one machine."""

from dataclasses import replace

import numpy as np
import pytest
from heavy_drive import HEAVY

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.study.tune import tune_loop

LIMIT = 500.0


def heavy(controller, **values):
    return Loop(controller, "drive_lugre+force", plant_values=HEAVY, controller_values=values)


@pytest.fixture(scope="module", params=["pid", "p_pi"])
def tuned(request):
    return tune_loop(heavy(request.param), limit=LIMIT, budget=20)


def test_the_gains_are_better_than_the_start_and_in_their_ranges(tuned):
    found = tuned.tuned
    assert found.doubled_cost <= found.cost < 0.5 * found.published_cost
    for gain in tuned.gains:
        assert gain.low <= gain.value <= gain.high
        assert tuned.loop.controller_values[gain.name] == gain.value


def test_the_limit_is_held_on_what_was_tuned_and_on_what_judges(tuned):
    assert all(np.abs(m.course.command).max() <= LIMIT * (1 + 1e-9) for m in tuned.motions)
    assert [m.duty.tune for m in tuned.motions] == [True, True, False]
    assert tuned.loop.plant_values["voltage_limit"] == LIMIT


def test_the_loop_is_robust_and_both_states_are_named(tuned):
    assert [(m.state, m.speed) for m in tuned.margins] == [("stuck", 0.0), ("sliding", 0.2)]
    assert all(m.stable and m.sensitivity <= 2.02 for m in tuned.margins)
    assert tuned.trusted


@pytest.mark.ci
def test_what_weakens_a_result_is_said(tuned):
    step, *others = tuned.motions
    margin = tuned.margins[0]
    beyond = replace(step, figures=step.figures._replace(peak_command=1.1 * LIMIT))
    more, less = (replace(tuned.tuned, doubled_cost=k * tuned.tuned.cost) for k in (0.8, 0.95))
    for changes, said, trusted in (
        ({"motions": (beyond, *others)}, "the step demands more than the limit", True),
        ({"motions": (replace(step, converged=False), *others)}, "is not converged", False),
        ({"tuned": more}, "twice the budget would gain 20 %", True),
        ({"margins": (replace(margin, sensitivity=2.5),)}, "Ms is more than 2 while stuck", True),
        ({"margins": (replace(margin, stable=False),)}, "unstable while stuck", False),
        ({"gains": (replace(tuned.gains[0], at_end="high"),)}, "is at the high end of", True),
    ):
        weaker = replace(tuned, **changes)
        assert said in " ".join(weaker.doubts())
        assert weaker.trusted == trusted
    assert "budget" not in " ".join(replace(tuned, tuned=less).doubts())


@pytest.mark.ci
def test_a_body_that_sticks_as_a_mode_has_margins_only_where_it_slides():
    rigid = {n: v for n, v in HEAVY.items() if n not in ("sigma0", "sigma1")}
    found = tune_loop(Loop("pid", "drive_classical", plant_values=rigid), limit=LIMIT, budget=2)
    assert [m.state for m in found.margins] == ["sliding"]
    assert "no bristles" in found.no_margins[0]


@pytest.mark.ci
def test_a_sampled_controller_is_tuned_at_its_period():
    found = tune_loop(heavy("p_pi+sampled", sample_time=2e-3), limit=LIMIT, budget=2)
    assert np.diff(found.motions[0].course.time) == pytest.approx(2e-3)
    assert found.margins[0].frequency[-1] == pytest.approx(250.0)  # half the sampling frequency
