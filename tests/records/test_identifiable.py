"""What several records cannot tell together is said before they are diagnosed."""

import numpy as np
import pytest

from ballscrew.records.bad_record import BadRecord
from ballscrew.records.identifiable import check_identifiable
from ballscrew.records.record import Record

TIME = np.arange(0.0, 4.0, 1e-3)
SWINGS = {"time": TIME, "u": np.sin(3 * TIME), "x": 0.1 * np.sin(3 * TIME)}


def record(name="mine", notes=(), **signals):
    return Record(name, SWINGS | signals, 1e-3, notes=notes)


@pytest.mark.ci
def test_doubts_of_each_record_are_said_with_what_was_done_on_reading():
    notes = check_identifiable([record(notes=("resampled",)), record("other", x=0.1 * TIME)])
    assert notes[0] == "mine: resampled"
    assert notes[1].startswith("other: moves in one direction only")


@pytest.mark.ci
def test_records_with_and_without_a_current_are_not_one_study():
    with pytest.raises(BadRecord, match="some records have the current `i` and some do not"):
        check_identifiable([record(), record(i=SWINGS["u"])])
