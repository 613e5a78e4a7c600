"""What records cannot tell is said before they are diagnosed."""

import numpy as np
import pytest

from ballscrew.records.bad_record import BadRecord
from ballscrew.records.drive_record import DriveRecord
from ballscrew.records.tellable import check_tellable

TIME = np.arange(0.0, 4.0, 1e-3)
SWINGS = {"time": TIME, "u": np.sin(3 * TIME), "x": 0.1 * np.sin(3 * TIME)}


def record(**signals):
    return DriveRecord("mine", SWINGS | signals, 1e-3)


def test_a_sound_record_has_no_doubts():
    assert check_tellable([record()]) == []


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ({"x": 0.1 * TIME}, "moves one way only"),
        ({"u": np.clip(np.sin(3 * TIME), -0.9, 0.9)}, "u is at its largest value in"),
    ],
)
def test_doubts_are_said(signals, words):
    (note,) = check_tellable([record(**signals)])
    assert words in note


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ({"x": np.full(len(TIME), 0.3)}, "the position never changes"),
        ({"u": np.zeros(len(TIME))}, "the command u is zero"),
    ],
)
def test_records_that_tell_nothing_are_refused(signals, words):
    with pytest.raises(BadRecord, match=words):
        check_tellable([record(**signals)])
