"""The motion of a record: right acceleration, no lag, delays put right."""

from __future__ import annotations

import numpy as np
import pytest
from identification.records import COUNT, LUGRE, record_of, sine_velocity, true_friction

from ballscrew.measurement.identification.motion import motion_of, smooth_motion
from ballscrew.measurement.records.record import Record, held_samples


def test_the_force_less_mass_times_acceleration_is_the_friction_of_a_moving_mass():
    trial = sine_velocity(2e-3, 2.0, 12.0)
    record = record_of(trial, "lugre", LUGRE, np.random.default_rng(1), noise=0.03, mass=20.0)
    friction = record.force - 20.0 * motion_of(record).a
    h = 2.5e-4
    fine = h * np.arange(round(12.0 / h))
    truth = true_friction("lugre", trial.position(fine), h, LUGRE)[::20]
    sliding = np.abs(2e-3 * np.sin(2 * record.time)) > 5e-4
    error = (friction - truth)[sliding]
    assert error.std() < 0.06  # the noise of the cell, and 20 kg times that of the acceleration
    assert abs(error.mean()) < 5 * error.std() / np.sqrt(len(error))


def test_smoothed_motion_does_not_lag_and_stays_within_a_count():
    time = 0.005 * np.arange(3000)
    x = 1e-3 * (1 - np.cos(time))
    v = 1e-3 * np.sin(time)
    inner = slice(50, -50)
    for origin in (0.0, 0.2, 0.3, 0.5, 0.8):
        seen = np.floor(x / COUNT + origin) * COUNT
        motion = smooth_motion(seen, 0.005)
        lag = np.sum((v - motion.v)[inner] * np.gradient(v, 0.005)[inner])
        lag /= np.sum(np.gradient(v, 0.005)[inner] ** 2)
        assert abs(lag) < 5e-4
        assert motion.resolution == pytest.approx(COUNT, rel=1e-6)
        # Where the body moves by whole counts a sample, all samples near lie at the same place of
        # their counts: the readings are off by up to half a count there in the same way, and the
        # smooth course may leave a reading by a little besides. Elsewhere it is far better: the
        # readings' own error has a root mean square of 0.29 counts.
        assert np.abs(motion.x - seen)[inner].max() < 0.6 * COUNT
        error = (motion.x - x)[inner] / COUNT
        assert np.abs(error - np.median(error)).max() < 1.0
        assert error.std() < 0.08


def test_signals_of_different_lags_are_brought_together():
    time = 0.005 * np.arange(2000)

    def unexplained(lags):
        """Force less mass times acceleration of a record whose position is 35 ms late."""
        late = 1e-3 * np.sin(2 * (time - 0.035))
        signals = {"time": time, "force": -4e-3 * np.sin(2 * time), "x": late}
        motion = motion_of(Record("a", signals, 0.005, lags=lags))
        return np.abs(signals["force"] - motion.a)[50:-50].max(), motion.x

    put_right, x = unexplained({"x": 0.035, "force": 0.0})
    assert np.abs(x - 1e-3 * np.sin(2 * time))[50:-50].max() < 1e-9
    assert put_right < 1e-6
    left_alone, _ = unexplained({})
    assert left_alone > 1e-4


def test_a_held_position_counts_where_it_was_converted():
    x = 1e-5 * np.sin(0.005 * np.arange(2000))
    held = np.repeat(x[::8], 8)
    assert len(held_samples(held)) == 250
    motion = smooth_motion(held, 0.005, later=0.0175)  # mean lag of values held for eight samples
    assert np.abs(motion.x - x)[50:-50].max() < 2e-8
