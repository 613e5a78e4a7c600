"""What is held out, and in which order causes are told."""

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal

from ballscrew.diagnosis.held_out import lap, parts_of
from ballscrew.diagnosis.modelled_record import lay_along

STEP = 1e-3
TIME = np.arange(0.0, 20.0, STEP)


@pytest.mark.parametrize("laps", [3, 4, 6])
def test_a_motion_that_repeats_is_held_out_by_laps(laps):
    length = 20.0 / laps
    x = np.sin(2 * np.pi * TIME / length) + 0.4 * np.cos(6 * np.pi * TIME / length + 1.0)
    noisy = x + 1e-3 * np.random.default_rng(1).standard_normal(len(x))
    assert lap(noisy, STEP) == pytest.approx(length, abs=2 * STEP)


def test_a_motion_that_starts_late_and_ends_early_has_laps_all_the_same():
    x = np.sin(2 * np.pi * TIME / 5.5) ** 3
    assert lap(x, STEP) == pytest.approx(5.5, abs=2 * STEP)


@pytest.mark.parametrize(
    "x",
    [
        np.sin(TIME**1.5),
        np.sin(2 * np.pi * TIME / 15.0),
        np.cumsum(np.random.default_rng(2).standard_normal(len(TIME))),
        np.sin(2 * np.pi * TIME / 5.0) * (1.0 + 0.5 * TIME / 20.0),
        np.zeros(len(TIME)),
    ],
    ids=["faster and faster", "less than twice", "wandering", "growing", "at rest"],
)
def test_a_motion_that_does_not_repeat_has_no_laps(x):
    assert lap(x, STEP) == 0.0


def test_many_short_laps_are_held_out_together():
    """Of a sine of a second twenty laps; those held out are a whole number of them."""
    length = lap(np.sin(2 * np.pi * TIME), STEP)
    assert length == pytest.approx(round(length), abs=2 * STEP)
    assert 20.0 / 7 <= length <= 20.0 / 3


def test_mixed_parts_leave_next_to_each_stretch_one_to_learn_from():
    course = lay_along(strong_record({}, samples=6_000), nominal())
    in_time, mixed = (parts_of([course], [], mixed=m) for m in (False, True))
    assert np.all(np.diff(in_time) >= 0)
    assert np.all(np.diff(mixed) != 0)
    assert sorted(set(mixed)) == sorted(set(in_time)) == list(range(5))
