"""What is held out, and what is left of it."""

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal

from ballscrew.measurement.diagnosis.fit import study_of
from ballscrew.measurement.diagnosis.held_out import held_out, lap
from ballscrew.measurement.diagnosis.rule import explained
from ballscrew.measurement.records.reading import check_record

STEP = 1e-3
TIME = np.arange(0.0, 20.0, STEP)


@pytest.mark.parametrize("laps", [3, 6])
def test_a_motion_that_repeats_has_laps(laps):
    length = 20.0 / laps
    x = np.sin(2 * np.pi * TIME / length) + 0.4 * np.cos(6 * np.pi * TIME / length + 1.0)
    noisy = x + 1e-3 * np.random.default_rng(1).standard_normal(len(x))
    assert lap(noisy, STEP) == pytest.approx(length, abs=2 * STEP)


@pytest.mark.parametrize(
    "x",
    [
        np.sin(TIME**1.5),
        np.sin(2 * np.pi * TIME / 15.0),
        np.sin(2 * np.pi * TIME / 5.0) * (1.0 + 0.5 * TIME / 20.0),
    ],
    ids=["faster and faster", "less than twice", "growing"],
)
def test_a_motion_that_does_not_repeat_has_no_laps(x):
    assert lap(x, STEP) == 0.0


@pytest.mark.ci
def test_what_is_left_of_a_block_does_not_know_the_block():
    """A load on the last fifth only: of that block all of it is left, whatever is fitted."""
    record = strong_record({}, samples=10_000)
    late = np.arange(10_000) >= 8_000
    model = nominal()
    u = record.signals["u"] + late * 0.3 / model.linear.per_command
    found = held_out(explained(study_of([check_record("made", record.signals | {"u": u})], model)))
    assert abs(np.mean(found.none.force[8_200:9_800])) == pytest.approx(0.3, rel=0.2)
    assert abs(np.mean(found.none.force[2_200:5_800])) < 0.1
