"""A p-value is the share of faultless records with as much evidence."""

from __future__ import annotations

import json
import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.diagnosis.faultless import p_value

PROOF = Path(__file__).parents[2] / "docs" / "proof" / "diagnosis_worlds.json"


def known():
    text = (files("ballscrew.diagnosis") / "faultless_evidence.csv").read_text(encoding="utf-8")
    return np.array([float(line) for line in text.splitlines()[1:]])


def test_no_record_is_rarer_than_one_of_those_known_and_itself():
    assert p_value(math.inf) == pytest.approx(1 / (1 + len(known())))
    assert p_value(-math.inf) == 1.0


@given(st.floats(-10, 1e5), st.floats(0, 1e5))
def test_more_evidence_is_never_more_common(evidence, more):
    assert p_value(evidence + more) <= p_value(evidence)


def test_the_records_known_are_the_faultless_ones_of_the_stored_proof():
    rows = json.loads(PROOF.read_text(encoding="utf-8"))["rows"]
    found = [r["evidence"] for r in rows if r["group"] == "faultless" and r["evidence"] is not None]
    assert known() == pytest.approx(np.sort(found), rel=1e-5)


def test_of_faultless_records_of_other_worlds_a_twentieth_has_a_p_value_below_a_twentieth():
    """Within what chance allows of 300 records that are alike by world."""
    told = json.loads(PROOF.read_text(encoding="utf-8"))["p_values_of_faultless_records"]
    assert told["all worlds"]["records"] == 300
    assert told["all worlds"]["kolmogorov_p"] > 0.01
    assert told["all worlds"]["share_at_most"]["0.05"] == pytest.approx(0.05, abs=0.03)
