"""Which samples are at reversals, slow, fast, accelerating: of motions known by hand."""

import numpy as np
import pytest
from diagnosed import nominal

from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.identification.motion_parts import motion_parts
from ballscrew.measurement.records.reading import check_record

STEP = 1e-3


def parts_of(v):
    time = STEP * np.arange(len(v))
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * STEP])
    record = check_record("made", {"time": time, "u": 20.0 * v, "x": x})
    course = lay_along(record, nominal())
    return motion_parts(course.step, course.v, course.mean_a, course.rests)


def strokes():
    """Fast forwards, slow forwards, fast backwards, slow backwards, two seconds each."""
    speeds = np.repeat([0.05, 0.01, -0.05, -0.01, 0.05], 2000)
    return np.convolve(np.pad(speeds, 50, mode="edge"), np.ones(101) / 101, mode="valid")


def test_parts_are_where_they_were_put_and_a_drive_at_rest_is_in_no_other():
    v = strokes()
    parts = parts_of(v)
    middle = np.zeros(len(v), dtype=bool)
    for start in range(0, len(v), 2000):
        middle[start + 300 : start + 1700] = True
    slow = np.abs(v) < 0.02
    assert np.all(parts["slow"][middle & slow])
    assert np.all(parts["fast"][middle & ~slow])
    assert np.all(parts["steady"][middle])
    assert np.all(parts["forwards"][middle & (v > 0)])
    # the ramps take 0.1 s, and the motion turns round at 4 s and at 8 s
    assert not np.any(parts["reversals"][middle])
    for turn in (4000, 8000):
        assert np.any(parts["reversals"][turn - 100 : turn + 100])
    assert parts["accelerating"][[2000, 4000, 6000, 8000]].all()
    v[4000:5000] = 0.0
    parts = parts_of(v)
    assert parts.pop("rest")[4200:4800].all()
    assert not any(mask[4200:4800].any() for mask in parts.values())


def test_a_fast_sine_is_not_all_reversal():
    parts = parts_of(0.05 * np.sin(2 * np.pi * 3.0 * STEP * np.arange(4000)))
    share = parts["reversals"].mean()
    assert share == pytest.approx(2 / np.pi * np.arcsin(0.2), rel=0.1)
    assert [name for name, mask in parts.items() if not mask.any()] == ["rest"]
