"""What noise alone leaves, a jump of the position, and a current that contradicts the voltage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal

from ballscrew.measurement.diagnosis.balance import noise_of_readings, residual, rms
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.records.reading import check_record

pytestmark = pytest.mark.ci


def test_reading_anew_changes_as_much_as_rounding_leaves_under_the_true_model():
    count = 2e-6
    record = strong_record({}, samples=4_000)
    signals = record.signals | {"x": count * np.round(record.x / count)}
    courses = [lay_along(check_record("counted", signals), nominal())]
    found = residual(courses, nominal())
    law = np.mean(np.concatenate([c.force_variance for c in courses]))
    known = math.hypot(noise_of_readings(courses, nominal()).force_rms, math.sqrt(law))
    assert 0.5 < found.force_rms / known < 2.0


def test_a_jump_is_named_and_changes_nothing_else():
    """Friction of half its size in the model, and ten micrometres at three seconds."""
    record = strong_record({}, samples=6_000)
    x = record.x + 1e-5 * (record.time > record.time[3_000])
    jumped = check_record("made", record.signals | {"x": x})
    model = nominal()
    wrong = model.changed({"Fc": 2.0 * model.values["Fc"]})
    as_it_is, found = (diagnose_records([r], wrong) for r in (record, jumped))
    assert found.verdict == as_it_is.verdict != "none"
    assert [c.name for c in found.causes] == [c.name for c in as_it_is.causes]
    assert found.floor.force == pytest.approx(as_it_is.floor.force, rel=0.1)
    (note,) = (n for n in found.notes if "x jumps by" in n)
    assert f"at {record.time[3_001]:.6g} s (1 in all)" in note
    assert not any("x jumps by" in n for n in as_it_is.notes)
    assert float(note.partition("x jumps by ")[2].split()[0]) == pytest.approx(10.0, abs=2.0)


def test_voltage_and_current_that_contradict_each_other_are_not_cleared():
    record = strong_record({}, with_current=True, samples=4_000)
    courses = [lay_along(record, nominal())]
    right = residual(courses, nominal())
    signals = record.signals | {"i": 2.0 * record.signals["i"]}
    courses = [lay_along(check_record("twice", signals), nominal())]
    twice = residual(courses, nominal())
    assert twice.by_current_rms > 20.0 * right.by_current_rms
    force = nominal().linear.per_ampere * rms(record.signals["i"])
    assert twice.by_current_rms == pytest.approx(force, rel=0.1)
