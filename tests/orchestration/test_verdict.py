"""The verdict against exact solutions: wrong results are never called trusted."""

import json
from pathlib import Path

import linear_loops
import nonlinear_loops
import numpy as np
import pytest
from trusted_loops import RIGHT, WRONG, lower_bound, plain, summaries, summary, upper_bound

from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.master import run_loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.verdict import Verdict, second_verdict

ROOT = Path(__file__).resolve().parents[2]
LOOPS, PARTS = 40, 2
OUTCOMES = {"linear": linear_loops.outcome, "nonlinear": nonlinear_loops.outcome}


def stored():
    return json.loads((ROOT / "docs" / "proof" / "trusted_loops.json").read_text())


@pytest.mark.parametrize("part", range(PARTS))
def test_wrong_results_of_random_stiff_loops_are_not_trusted_and_most_right_ones_are(part):
    """Half of them at a time so that workers share them; a thousand: proofs/trusted_loops.py."""
    outcomes = [linear_loops.outcome(seed) for seed in range(part, LOOPS, PARTS)]
    wrong = [o for o in outcomes if o.error > WRONG]
    right = [o for o in outcomes if o.error <= RIGHT]
    assert len(wrong) >= 6
    assert [o for o in wrong if o.trusted] == []
    assert len(right) >= 3
    assert sum(o.trusted for o in right) >= 0.7 * len(right)


@pytest.mark.parametrize("family", range(len(nonlinear_loops.FAMILIES)))
def test_wrong_results_of_loops_that_stick_hit_switch_or_sample_are_not_trusted(family):
    seeds = range(family, 5 * len(nonlinear_loops.FAMILIES), len(nonlinear_loops.FAMILIES))
    found = summary([plain(nonlinear_loops.outcome(seed)) for seed in seeds])
    assert found["wrong"] + found["right"] >= 3
    assert found["wrong_called_trusted"] == []
    assert found["right_called_trusted"] == found["right"]


@pytest.mark.parametrize(("gap", "trusted"), [(0.55, True), (0.500_01, False), (0.499_99, False)])
def test_a_jump_closer_to_a_communication_point_than_its_time_is_known_is_not_trusted(gap, trusted):
    """A mass that nothing drives hits the stop at t = gap; the communication points are tenths."""
    still = {"k": 0.0, "c": 0.0, "shake": 0.0}
    plant, controller = (
        nonlinear_loops.ModelInstance(
            "plant",
            nonlinear_loops._plant_kernel("stops", False, False),
            {**still, "gap": gap, "v_start": 1.0},
        ),
        nonlinear_loops.ModelInstance(
            "controller",
            nonlinear_loops._controller_kernel("pid", False, False),
            {"Kp": 0.0, "Kd": 0.0},
        ),
    )
    run = run_loop(plant, controller, Reference.constant(0.0), 1.0, 0.1)
    assert run.verdict.trusted == trusted
    assert run.verdict.error_estimate["v"] == pytest.approx(0.0 if trusted else 1.5, abs=1e-9)


def test_a_body_that_breaks_loose_at_the_start_itself_is_trusted(native):
    """Its flag of sticking jumps right after the start, whose value is given."""
    study = Loop("pid", str(native("plant_classical")), stop=0.05, step=1e-3)
    run = run_closed_loop(study).run
    assert run.outputs["stuck"][:3].tolist() == [1.0, 0.0, 0.0]
    assert run.verdict.trusted
    assert run.verdict.error_estimate["stuck"] == 0.0


def test_a_relay_that_switches_late_in_the_run_and_its_first_co_run_does_not_deceive():
    o = nonlinear_loops.outcome(30066)
    assert o.error > WRONG
    assert not o.trusted


def test_the_bounds_of_rates_are_those_of_clopper_and_pearson():
    assert upper_bound(0, 1000) == pytest.approx(1 - 0.05 ** (1 / 1000))
    assert upper_bound(0, 1000) < 0.003
    assert lower_bound(10, 10) == pytest.approx(0.05 ** (1 / 10))
    assert upper_bound(10, 10) == 1.0


def test_the_kept_proof_says_what_its_outcomes_say():
    report = stored()
    assert report["summary"] == summaries(**report["outcomes"])
    for kind, loops, wrong in (("linear", 1000, 300), ("nonlinear", 300, 100)):
        found = report["summary"][kind]
        assert found["loops"] - found["truth_not_known"] >= loops
        assert found["wrong"] >= wrong
        assert found["wrong_called_trusted"] == []
        assert found["right_called_trusted"] >= 0.95 * found["right"]


@pytest.mark.parametrize("kind", OUTCOMES)
def test_a_sample_of_the_kept_proof_comes_out_the_same_again(kind):
    for row in stored()["outcomes"][kind][200:205]:
        again = OUTCOMES[kind](row["seed"])
        assert again.trusted == row["trusted"]
        if row["error"] is not None:
            assert again.error == pytest.approx(row["error"], rel=1e-3, abs=1e-9)


@pytest.mark.parametrize(("late", "trusted"), [(1, True), (30, False)])
def test_a_flag_is_judged_by_the_share_of_time_that_it_is_wrong(late, trusted):
    """Where all else agrees: at the point where it changes it is wrong by all of its range."""
    time = np.linspace(0.0, 1.0, 1001)
    runs = [np.column_stack([time, time > t]) for t in (0.5, 0.5 + 1e-3 * late, 0.5)]
    run, half, quarter = (r.astype(float) for r in runs)
    first = Verdict(True, "", "", {"x": 0.0, "stuck": 0.0})
    found = second_verdict(first, run, half, quarter, None, np.zeros(2))
    assert found.trusted is trusted
    assert found.error_estimate["stuck"] == pytest.approx(1e-3 * late, rel=1e-2)
