"""A constant force beside the friction is found with its interval; what is known may be held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic.records import record_of, sine_velocity

from ballscrew.measurement.identification.identify import check_held, identify
from ballscrew.orchestration.loop.parameter_file import ParameterFile
from ballscrew.solver.errors import BadParameter

DAHL = {"sigma": 87750.0, "Fc": 2.0, "alpha": 1.0}
LOAD = 0.6
DRIVE = ParameterFile(kind="drive")


def loaded(record, load=LOAD):
    """The record of a drive that a constant force pulls at, as a block on a slope has it."""
    return replace(record, signals={**record.signals, "force": record.force + load})


def mostly_forwards(seed, law=DAHL, load=LOAD):
    """Three trials forwards and one backwards."""
    random = np.random.default_rng(seed)
    trials = [sine_velocity(s * 1e-3, 1.0, 3.15) for s in (1, 1, 1, -1)]
    return [loaded(record_of(t, "dahl", law, random), load) for t in trials]


@pytest.fixture(scope="module")
def found():
    return identify(mostly_forwards(1), "dahl", DRIVE, offset=True)


def test_a_constant_force_is_found_with_its_interval(found):
    offset = found.parameters["offset"]
    assert offset.identified
    assert offset.unit == "N"
    assert offset.low <= LOAD <= offset.high
    assert offset.high - offset.low < 0.1
    for name, truth in DAHL.items():
        interval = found.parameters[name]
        assert interval.low <= truth <= interval.high, name
    assert found.trusted


@pytest.mark.ci
@pytest.mark.parametrize(
    ("law", "fixed", "offset", "words"),
    [
        ("dahl", {"offset": float("nan")}, False, "expected a finite number"),
        ("bliman_sorine", {"f1": 1.0}, False, "fitted together with f2, eta"),
        ("maxwell_slip", {"alpha1": 0.2}, False, "cannot be fixed alone"),
        ("directional_lugre", {"Fc": 1.0}, False, "no parameter 'Fc'"),
        ("directional_lugre", {}, True, "fix offset at a value"),
    ],
)
def test_what_cannot_be_held_or_told_is_refused_in_one_line(law, fixed, offset, words):
    with pytest.raises(BadParameter, match=words) as refused:
        check_held(law, fixed, offset)
    assert "\n" not in str(refused.value)
