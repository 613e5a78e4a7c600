"""The verdict against exact solutions: wrong results are never called trusted."""

import json
from pathlib import Path

import pytest
from linear_loops import outcome
from trusted_loops import WRONG

ROOT = Path(__file__).resolve().parents[2]
LOOPS, PARTS = 40, 2


@pytest.mark.parametrize("part", range(PARTS))
def test_wrong_results_of_random_stiff_loops_are_not_trusted_and_most_right_ones_are(part):
    """Half of them at a time so that workers share them; a thousand: proofs/trusted_loops.py."""
    outcomes = [outcome(seed) for seed in range(part, LOOPS, PARTS)]
    wrong = [o for o in outcomes if o.error > WRONG]
    right = [o for o in outcomes if o.error <= WRONG / 3]
    assert len(wrong) >= 6
    assert [o for o in wrong if o.trusted] == []
    assert len(right) >= 3
    assert sum(o.trusted for o in right) >= 0.7 * len(right)


def test_the_kept_proof_says_what_its_outcomes_say():
    report = json.loads((ROOT / "docs" / "proof" / "trusted_loops.json").read_text())
    assert report["summary"]["loops"] == len(report["outcomes"]) >= 1000
    wrong = [o for o in report["outcomes"] if o["error"] is None or o["error"] > WRONG]
    assert report["summary"]["wrong"] == len(wrong) > 300
    assert [o["seed"] for o in wrong if o["trusted"]] == []


def test_a_sample_of_the_kept_proof_comes_out_the_same_again():
    report = json.loads((ROOT / "docs" / "proof" / "trusted_loops.json").read_text())
    for row in report["outcomes"][500:505]:
        again = outcome(row["seed"])
        assert again.trusted == row["trusted"]
        if row["error"] is not None:
            assert again.error == pytest.approx(row["error"], rel=1e-3)
