"""What a record shows before any model: counts, bandwidth, clipping, and what cannot be used."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, firwin, sosfiltfilt

from ballscrew.measurement.records.examine import carried, check_identifiable, clipped
from ballscrew.measurement.records.record import Record
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


@pytest.mark.parametrize(
    ("x", "resolution"),
    [
        (np.round((WAY + 3.3e-7) / COUNT) * COUNT + 7.1e-7, COUNT),
        (with_digits(COUNTED), COUNT),
        (np.round((WAY + 0.2 * COUNT * RANDOM.standard_normal(len(WAY))) / COUNT) * COUNT, COUNT),
        (np.round((WAY + 2 * COUNT * RANDOM.standard_normal(len(WAY))) / COUNT) * COUNT, 0.0),
        (with_digits(WAY + 1e-7 * RANDOM.standard_normal(len(WAY))), 0.0),
        (with_digits(WAY), 0.0),
    ],
    ids=["round", "text", "trembling", "noisy", "digits", "smooth"],
)
def test_the_resolution_of_an_encoder_is_found_and_none_where_noise_hides_it(x, resolution):
    seen = look(x)
    assert seen.resolution == pytest.approx(resolution, rel=1e-4)
    assert carried(seen) == 500.0


def low_passed(x, corner):
    taps = firwin(101, corner, fs=1 / STEP)
    return np.convolve(np.pad(x, 50, "edge"), taps, "valid")


@pytest.mark.ci
@pytest.mark.parametrize(
    ("x", "least", "most"),
    [
        (low_passed(COUNTED, 300.0), 200.0, 320.0),
        (sosfiltfilt(butter(4, 300, fs=1 / STEP, output="sos"), COUNTED), 200.0, 350.0),
        (np.interp(TIME, TIME[::4], COUNTED[::4]), 125.0, 125.0),
        (np.repeat((WAY + 1e-7 * RANDOM.standard_normal(len(WAY)))[::10], 10), 50.0, 50.0),
    ],
    ids=["fir", "twice", "straight", "held"],
)
def test_what_a_filter_or_interpolation_left_of_a_position_is_said(x, least, most):
    seen = look(x)
    assert seen.resolution == 0.0
    assert least <= carried(seen) <= most
    (note,) = check_identifiable([seen])
    assert f"no content above {carried(seen):.3g} Hz, of the 500 Hz possible" in note


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
    assert carried(look(way)) == 500.0
    assert check_identifiable([look(way)]) == []


def test_clipped_samples_are_marked():
    u = np.sin(3 * TIME)
    cut = np.clip(u, -0.9, 0.8)
    np.testing.assert_array_equal(clipped(cut), (u >= 0.8) | (u <= -0.9))
    (note,) = check_identifiable([look(u=cut)])
    assert "u is at its largest value in" in note


@pytest.mark.ci
def test_a_smooth_top_is_not_clipped_and_neither_is_a_step_of_the_converter():
    u = np.round(np.sin(3 * TIME + 0.1 * RANDOM.standard_normal(len(TIME))) / 0.01) * 0.01
    assert np.mean(clipped(u)) < 0.1
    assert clipped(np.sin(3 * TIME)).sum() == 0


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
