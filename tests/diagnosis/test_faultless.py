"""A p-value is the share of faultless records with as much evidence."""

from __future__ import annotations

import math
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.diagnosis.faultless import p_value


def known():
    text = (files("ballscrew.diagnosis") / "faultless_evidence.csv").read_text(encoding="utf-8")
    return np.array([float(line) for line in text.splitlines()[1:]])


def test_no_record_is_rarer_than_one_of_those_known_and_itself():
    assert p_value(math.inf) == pytest.approx(1 / (1 + len(known())))
    assert p_value(-math.inf) == 1.0


@given(st.floats(-10, 1e5), st.floats(0, 1e5))
def test_more_evidence_is_never_more_common(evidence, more):
    assert p_value(evidence + more) <= p_value(evidence)
