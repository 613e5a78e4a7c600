"""A p-value is the share of like faultless records with as much evidence."""

from __future__ import annotations

import json
import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from ballscrew.diagnosis.faultless import NEAREST, RecordKind, p_value, share_alike

PROOF = Path(__file__).parents[2] / "docs" / "proof" / "diagnosis_worlds.json"
KIND = RecordKind(noise=0.05, inertia=20.0, step=1e-3, current=1.0, classical=0.0)


def known():
    with (files("ballscrew.diagnosis") / "faultless_evidence.csv").open(encoding="utf-8") as table:
        return np.loadtxt(table, delimiter=",", skiprows=1)


def test_no_record_is_rarer_than_one_of_those_like_it_and_itself():
    assert p_value(math.inf, KIND) == pytest.approx(1 / (1 + NEAREST))
    assert p_value(-math.inf, KIND) == 1.0


@given(st.floats(-10, 1e5), st.floats(0, 1e5), st.sampled_from(range(len(known()))))
def test_more_evidence_is_never_more_common(evidence, more, which):
    kind = RecordKind(*known()[which, 1:])
    assert p_value(evidence + more, kind) <= p_value(evidence, kind)


def test_p_values_are_even_in_each_of_two_kinds_that_have_nothing_in_common():
    """One kind has a hundred times the evidence of the other: pooled, p-values are not even."""
    random = np.random.default_rng(0)
    kinds = KIND, KIND._replace(inertia=2.0, step=1e-2, current=0.0)
    scales = 1.0, 100.0

    def drawn(which, count):
        evidence = scales[which] * random.exponential(size=count)
        return np.column_stack([evidence, np.tile(kinds[which], (count, 1))])

    for which in (0, 1):
        alike, pooled = [], []
        for _ in range(300):
            both, new = np.vstack([drawn(0, 100), drawn(1, 100)]), drawn(which, 1)[0, 0]
            alike.append(share_alike(new, kinds[which], both))
            pooled.append(np.mean(both[:, 0] >= new))
        assert kstest(alike, "uniform").pvalue > 0.01
        assert kstest(pooled, "uniform").pvalue < 1e-6


def test_the_records_known_are_the_faultless_ones_of_the_stored_proof():
    rows = json.loads(PROOF.read_text(encoding="utf-8"))["rows"]
    found = [[r["evidence"], *r["kind"]] for r in rows if r["group"] == "faultless" and r["kind"]]
    assert known() == pytest.approx(np.array(sorted(found)), rel=1e-5)


def test_p_values_of_faultless_records_are_even_in_every_world():
    """Each record told by all others; a twentieth is within what chance allows of 300."""
    told = json.loads(PROOF.read_text(encoding="utf-8"))["p_values_of_faultless_records"]
    assert told["all worlds"]["records"] == len(known()) == 300
    assert all(found["kolmogorov_p"] > 0.01 for found in told.values())
    assert told["all worlds"]["share_at_most"]["0.05"] == pytest.approx(0.05, abs=0.03)
