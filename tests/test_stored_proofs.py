"""The files of `docs/proof/`: some of their trials made again."""

from __future__ import annotations

import pytest
from runner import stored

pytestmark = pytest.mark.ci  # their scripts are imported where they are used: some need numba


def test_the_stored_bound_of_wrong_results_called_trusted_is_that_of_clopper_and_pearson():
    from scipy.stats import binomtest

    for said in stored("trusted_loops")["summary"].values():
        deceived = len(said["wrong_called_trusted"])
        test = binomtest(deceived, said["wrong"], alternative="less")
        bound = test.proportion_ci(0.95, method="exact").high
        assert said["of_wrong_upper_95"] == pytest.approx(bound, rel=1e-6)


@pytest.mark.xdist_group("worlds")  # whose simulators are compiled once
def test_a_record_of_a_world_diagnosed_again_gets_the_stored_answer():
    from diagnosis import rule

    row = stored("diagnosis_rule")["example"]
    again = rule.trial(row["world"], row["effect"], row["seed"])
    assert rule.named(again) == rule.named(row)
    assert (again["verdict"], again["suspects"]) == (row["verdict"], row["suspects"])


@pytest.mark.parametrize("task", [("run", 1), pytest.param(("rig", 39), marks=pytest.mark.prove)])
def test_a_record_of_this_program_made_again_gets_the_stored_verdict_and_no_name(task):
    from diagnosis import own_records

    (again,) = own_records.trial(*task)
    assert again in stored("own_records")["again"]
    assert again["named"] == []


@pytest.mark.prove  # the proof is of the estimator before, until `make prove` makes it again
def test_a_rig_whose_interval_missed_the_truth_misses_it_again_by_the_same_bounds():
    from identification import intervals

    misses = stored("identification")["closed_loop"]["classical"]["misses"]
    before = {miss["parameter"]: miss for miss in misses if miss["seed"] == misses[0]["seed"]}
    again = intervals.trial("closed_loop", "classical", misses[0]["seed"])
    assert {row["parameter"] for row in again if not row["covered"]} == set(before)
    for row in (row for row in again if not row["covered"]):
        for field in ("truth", "value", "low", "high"):
            assert row[field] == pytest.approx(before[row["parameter"]][field], rel=1e-5)


def test_a_study_of_two_equal_controllers_made_again_ends_as_stored():
    from verdict import swap_study

    report = stored("swap_study")
    again = swap_study.trial(report["again"]["seed"])
    assert again["ratio"] == pytest.approx(report["again"]["ratio"], rel=1e-6)
    assert report["holds"]


def test_controllers_made_by_others_are_all_trusted_and_right():
    from interoperability import made_by_others

    report = stored("made_by_others")
    assert report["wrong"] == 0
    assert {row["made_by"] for row in report["rows"]} == {*made_by_others.KINDS}
    assert all(made_by_others.good(row) for row in report["rows"])
    assert all(r["error"] <= r["estimate"] for r in report["rows"] if not r.get("sampled"))


def test_the_stored_errors_of_tools_are_those_that_are_allowed():
    from interoperability import tools

    report = stored("tools")
    asked = {
        (j.tool, j.what, j.controller, *sorted(map(str, j.more.values()))): j for j in tools.jobs()
    }
    for row in report["rows"]:
        more = [str(row[n]) for n in ("kind", "tolerance", "method") if n in row]
        job = asked.pop((row["tool"], row["file"], row["controller"], *sorted(more)))
        assert row["error"] <= 2.0 * job.allowed
    assert {job.tool for job in asked.values()} == set(report["not_made"])
