"""The resolution, noise and held values of an instrument, from what it recorded."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.measurement.records.record import (
    encoder_count,
    fast_noise,
    held_samples,
    resolution_of,
)

COUNT = 1e-3 / 512  # m, of an encoder
CONVERTER = 0.089  # N
WAY = 3e-4 * np.sin(0.013 * np.arange(20_000)) + 1e-4 * np.sin(0.0031 * np.arange(20_000))


def test_resolution_is_found_in_samples_that_jump_over_levels_and_not_in_smooth_ones():
    random = np.random.default_rng(0)
    levels = np.cumsum(random.choice([14, 15], 400))
    assert resolution_of(levels * COUNT) == pytest.approx(COUNT, rel=1e-9)
    read = np.round(random.normal(1.5, 0.05, 2000) / CONVERTER) * CONVERTER
    assert resolution_of(read) == pytest.approx(CONVERTER, rel=1e-9)
    assert resolution_of(random.normal(size=500)) == 0.0


@pytest.mark.parametrize(("off", "step"), [(0.05, 5.0), (0.2, 0.2)])
def test_gaps_are_multiples_to_within_a_fiftieth_of_the_step(off, step):
    """The mean of gaps of 5 and 10, or a new and smaller step."""
    found = resolution_of(np.array([0.0, 5.0, 15.0 + off, 20.0 + off]))
    assert found == pytest.approx(step, rel=0.01)


@pytest.mark.parametrize(("off", "step"), [(0.7e-9, 1.0), (1.5e-9, 0.0)])
def test_what_the_digits_of_a_text_round_away_is_no_level(off, step):
    """A billionth of the largest value, which is 1000 here."""
    values = np.append(np.arange(1001.0), 500.0 + 1e3 * off)
    assert resolution_of(values) == pytest.approx(step, rel=1e-6)


@pytest.mark.parametrize("count", [0.0, 40.0])
def test_noise_is_that_of_sample_to_sample_and_neither_the_course_nor_a_jump(count):
    noise = 0.2 * np.random.default_rng(1).standard_normal(200_000)
    course = 30.0 * np.sin(1e-3 * np.arange(200_000)) + count * (np.arange(200_000) > 90_000)
    assert fast_noise(course + noise) == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize(("trembling", "hidden"), [(0.23, False), (0.31, True)])
def test_a_count_is_hidden_by_noise_of_more_than_four_tenths_of_it(trembling, hidden):
    """Rounding alone makes sqrt(1/12) = 0.29 of a count, with the trembling 0.37 and 0.42."""
    shaken = WAY + trembling * COUNT * np.random.default_rng(2).standard_normal(len(WAY))
    read = np.round(shaken / COUNT) * COUNT
    assert fast_noise(read) / COUNT == pytest.approx(np.sqrt(1 / 12 + trembling**2), rel=0.03)
    assert encoder_count(read) == pytest.approx(0.0 if hidden else COUNT, rel=1e-9)


def test_held_values_are_counted_where_they_are_new():
    x = np.sin(0.01 * np.arange(800))
    np.testing.assert_array_equal(held_samples(np.repeat(x[::8], 8)), np.arange(0, 800, 8))
    np.testing.assert_array_equal(held_samples(x), np.arange(800))
    np.testing.assert_array_equal(held_samples(np.repeat(x[:10], 8)), np.arange(0, 80, 8))
    # nine values are too few, and values that come again are counts of an encoder
    np.testing.assert_array_equal(held_samples(np.repeat(x[:9], 8)), np.arange(72))
    counted = np.repeat(np.arange(100) % 50, 8).astype(float)
    np.testing.assert_array_equal(held_samples(counted), np.arange(800))
    uneven = np.repeat(x[:100], np.tile([3, 4, 5, 7], 25))
    np.testing.assert_array_equal(held_samples(uneven), np.arange(len(uneven)))
    # one run of ten that differs is too many; the first of all may have begun before the record
    once = np.repeat(x[:12], [4, 7, *[4] * 10])
    np.testing.assert_array_equal(held_samples(once), np.arange(len(once)))
    # one held longer, by a value that came twice
    twice = np.delete(np.repeat(x[:100], 8), 0)
    assert len(held_samples(np.r_[twice[:400], np.repeat(x[50], 8), twice[400:]])) == 100
