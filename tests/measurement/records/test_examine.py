"""What a record shows before any model: counts, noise, held values, bandwidth, clipping."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, firwin, sosfiltfilt

from ballscrew.measurement.records.examine import carried, check_identifiable, clipped
from ballscrew.measurement.records.record import Record, fast_noise, held_samples, resolution_of
from ballscrew.solver.errors import BadRecord

STEP = 1e-3
TIME = np.arange(0.0, 20.0, STEP)
COUNT = 2e-6
WAY = 0.05 * np.sin(2 * np.pi * 0.3 * TIME) + 0.01 * np.sin(2 * np.pi * 1.7 * TIME + 1) + 0.13
COUNTED = np.floor(WAY / COUNT) * COUNT
RANDOM = np.random.default_rng(0)


def look(x=COUNTED, u=None):
    signals = {"time": TIME, "u": np.sin(3 * TIME) if u is None else u, "x": x}
    return Record("mine", signals, STEP)


def with_digits(values, digits=9):
    return np.array([float(f"{v:.{digits}g}") for v in values])


def trembling(counts):
    """Rounding alone makes sqrt(1/12) = 0.29 of a count: with 0.23 in all 0.37, with 0.31 0.42."""
    return np.round((WAY + counts * COUNT * RANDOM.standard_normal(len(WAY))) / COUNT) * COUNT


@pytest.mark.parametrize(
    ("x", "resolution"),
    [
        (np.round((WAY + 3.3e-7) / COUNT) * COUNT + 7.1e-7, COUNT),
        (with_digits(COUNTED), COUNT),
        (trembling(0.23), COUNT),
        (trembling(0.31), 0.0),
        (with_digits(WAY + 1e-7 * RANDOM.standard_normal(len(WAY))), 0.0),
        (with_digits(WAY), 0.0),
    ],
    ids=["round", "text", "trembling", "noisy", "digits", "smooth"],
)
def test_the_resolution_of_an_encoder_is_found_and_none_where_noise_hides_it(x, resolution):
    seen = look(x)
    assert seen.resolution == pytest.approx(resolution, rel=1e-4)
    assert carried(seen) == 500.0


@pytest.mark.parametrize(
    ("values", "step"),
    [
        (np.cumsum(np.random.default_rng(0).choice([14, 15], 400)) * 0.089, 0.089),
        (np.array([0.0, 5.0, 15.05, 20.05]), 5.0),  # to within a fiftieth of the step
        (np.array([0.0, 5.0, 15.2, 20.2]), 0.2),
        (np.append(np.arange(1001.0), 500.0 + 0.7e-6), 1.0),  # a billionth of the largest: digits
        (np.append(np.arange(1001.0), 500.0 + 1.5e-6), 0.0),
    ],
)
def test_a_resolution_is_the_step_of_a_grid_whose_levels_may_be_jumped_over(values, step):
    assert resolution_of(values) == pytest.approx(step, rel=0.01)


@pytest.mark.parametrize("jump", [0.0, 40.0])
def test_noise_is_that_of_sample_to_sample_and_neither_the_course_nor_a_jump(jump):
    noise = 0.2 * np.random.default_rng(1).standard_normal(200_000)
    course = 30.0 * np.sin(1e-3 * np.arange(200_000)) + jump * (np.arange(200_000) > 90_000)
    assert fast_noise(course + noise) == pytest.approx(0.2, rel=0.01)


def test_held_values_are_counted_where_they_are_new():
    x = np.sin(0.01 * np.arange(800))
    np.testing.assert_array_equal(held_samples(np.repeat(x[::8], 8)), np.arange(0, 800, 8))
    np.testing.assert_array_equal(held_samples(np.repeat(x[:10], 2)), np.arange(0, 20, 2))
    # nine values are too few, and values that come again are counts of an encoder
    counted = np.repeat(np.arange(100) % 50, 8).astype(float)
    uneven = np.repeat(x[:100], np.tile([3, 4, 5, 7], 25))
    # one run of ten that differs is too many; the first of all may have begun before the record
    once = np.repeat(x[:12], [4, 7, *[4] * 10])
    for values in (x, np.repeat(x[:9], 8), counted, uneven, once):
        np.testing.assert_array_equal(held_samples(values), np.arange(len(values)))
    # one held longer, by a value that came twice
    twice = np.delete(np.repeat(x[:100], 8), 0)
    assert len(held_samples(np.r_[twice[:400], np.repeat(x[50], 8), twice[400:]])) == 100


@pytest.mark.parametrize("filtered", ["fir", "there and back"])
def test_what_a_filter_left_of_a_position_is_said(filtered):
    """A cut-off of 300 Hz: the spectrum has fallen by four powers of ten there, or soon after."""
    if filtered == "fir":
        taps = firwin(101, 300.0, fs=1 / STEP)
        seen = look(np.convolve(np.pad(COUNTED, 50, "edge"), taps, "valid"))
    else:
        seen = look(sosfiltfilt(butter(4, 300, fs=1 / STEP, output="sos"), COUNTED))
    (note,) = check_identifiable([seen])
    assert 300.0 <= 2 * carried(seen) <= 400.0
    assert f"no content above {2 * carried(seen):.3g} Hz, of the 500 Hz possible" in note


@pytest.mark.ci
def test_an_exact_motion_with_friction_is_not_taken_for_filtered():
    """A block with dry friction under steps of force, solved finely: smooth, but of all speeds."""
    force = np.repeat(RANDOM.uniform(-8, 8, 80), 250)
    x, v, fine = 0.0, 0.0, 5e-5
    way = np.empty(len(TIME))
    for k in range(len(TIME)):
        way[k] = x
        for _ in range(20):
            v += fine * (force[k] - 150 * v - np.tanh(v / 1e-4))
            x += fine * v
    assert check_identifiable([look(way)]) == []


def test_clipped_samples_are_marked_and_a_smooth_top_is_not():
    u = np.sin(3 * TIME)
    cut = np.clip(u, -0.9, 0.8)
    np.testing.assert_array_equal(clipped(cut), (u >= 0.8) | (u <= -0.9))
    (note,) = check_identifiable([look(u=cut)])
    assert "u is at its largest value in" in note
    assert clipped(u).sum() == 0


def test_a_record_with_the_current_alone_is_examined_by_it():
    current = np.clip(np.sin(3 * TIME), -0.9, 0.9)
    signals = {"time": TIME, "i": current, "x": COUNTED}
    (note,) = check_identifiable([Record("mine", signals, STEP, "current")])
    assert "i is at its largest value in" in note
    with pytest.raises(BadRecord, match="the current i is zero"):
        check_identifiable([Record("mine", signals | {"i": 0 * current}, STEP, "current")])


def test_doubts_of_each_record_are_said_and_a_current_in_some_alone_is_refused():
    signals = {"time": TIME, "u": np.sin(3 * TIME), "x": COUNTED}
    mended = Record("mine", signals, STEP, notes=("resampled",))
    notes = check_identifiable([mended, Record("other", signals | {"x": 0.1 * TIME}, STEP)])
    assert notes[0] == "mine: resampled"
    assert notes[1].startswith("other: moves in one direction only")
    with pytest.raises(BadRecord, match="some records have the current `i` and some do not"):
        check_identifiable([mended, Record("other", signals | {"i": signals["u"]}, STEP)])
