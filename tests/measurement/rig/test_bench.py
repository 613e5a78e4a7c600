"""Trials on the rig: what the instruments record, and what truth stands beside it."""

import math

import numpy as np
import pytest

from ballscrew.measured_results import RigRecord
from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.setup import POINTS, Noise, calibrate
from ballscrew.measurement.rig.trials import trials_named
from ballscrew.plant.instruments.acquisition import SAMPLE_TIME

QUIET = Noise(load_cell=0.0, capacitance=0.0, micrometer=0.0, separation=0.0)
FC, FS, VS, SIGMA2, SIGMA0 = 1.284, 2.35, 0.00113975, 173.0, 66967.231
MASS, ROTOR = 1.0, 4.2e-7 * (2 * math.pi * 1000) ** 2


def stribeck(v):
    return np.sign(v) * (FC + (FS - FC) * np.exp(-((v / VS) ** 2))) + SIGMA2 * v


def first_peak(force):
    """The largest value before the force first falls by a percent."""
    fallen = np.flatnonzero(force < 0.99 * np.maximum.accumulate(force))
    return float(np.max(force[: fallen[0]])) if len(fallen) else float(np.max(force))


@pytest.fixture(scope="module")
def slow_slide():
    return run_trial("2.4/7")


@pytest.mark.ci
@pytest.mark.parametrize("trial", ["2.6/6", "2.8/5"])
def test_the_load_cell_feels_friction_and_what_moves_the_block_with_the_rotor(trial):
    """Through the screw the rotor is 16.6 kg, which the motor's force moves, too."""
    found = run_trial(trial)
    truth = found.truth
    motor = 37.4e-3 * 2 * math.pi * 1000 * truth["i"]
    acceleration = (motor - truth["friction"]) / (MASS + ROTOR)
    expected = truth["friction"] + MASS * acceleration
    np.testing.assert_allclose(truth["force"], expected, atol=1e-12)
    off = found.record["force"] - truth["force"]
    assert np.abs(off).max() < 0.0445 + 5 * 0.03
    assert off.std() == pytest.approx(math.hypot(0.03, 0.089 / 12**0.5), rel=0.15)


def test_records_show_the_resolutions_of_the_instruments(slow_slide):
    counts = slow_slide.record["x"] * 512_000
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    steps = slow_slide.record["force"] / 0.089
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(slow_slide.record["x"] - slow_slide.truth["x"]).max() <= 1 / 512_000
    np.testing.assert_allclose(np.diff(slow_slide.record["time"]), 1 / 200, rtol=1e-9)


@pytest.mark.ci
def test_beyond_its_range_the_load_cell_reads_its_end_and_the_amplifier_gives_its_limit():
    heavy = run_trial("2.3.1/1", parameters={"Fc": 60.0, "Fs": 60.0})
    assert heavy.truth["force"].max() > 55
    assert heavy.record["force"].max() == 44.5
    assert "load cell is at the limit of its range, 44.5 N" in heavy.notes[0]
    weak = run_trial("2.3.1/8", parameters={"plant.voltage_limit": 0.8})
    assert weak.record["u"].max() > weak.truth["u"].max() == 0.8
    assert "amplifier is at its limit, 0.8 V" in weak.notes[0]
    assert run_trial("2.3.1/8").notes == []


@pytest.mark.ci
def test_recorded_columns_lag_as_the_description_says():
    """At a constant velocity, with an encoder that is as good as none."""
    speed = 5e-3
    found = run_trial("2.3.1/7", parameters={"encoder.counts": 1e9}, noise=QUIET)
    late = found.truth["time"] > 2
    lags = found.description()["lags"]
    for column in ("x", "x_filtered"):
        behind = (found.truth["x"] - found.record[column])[late] / speed
        assert behind.mean() == pytest.approx(lags[column], abs=1e-7)
    assert lags["x_filtered"] > 0.01
    slope = run_trial("loading-rate/1", parameters={"load_cell.resolution": 1e-9}, noise=QUIET)
    loading = (slope.truth["time"] > 3) & (slope.truth["time"] < 20)
    behind = (slope.truth["force"] - slope.record["force_filtered"])[loading]
    rate = np.polyfit(slope.truth["time"][loading], slope.truth["force"][loading], 1)[0]
    assert behind.mean() / rate == pytest.approx(
        slope.description()["lags"]["force_filtered"], 1e-2
    )


@pytest.mark.ci
def test_the_capacitance_sensor_gives_the_displacement_within_its_calibrations_error():
    outside = []
    for seed in range(20):
        found = run_trial("2.8/5", seed=seed)
        at_end = found.truth["time"] > 9
        mean = np.mean((found.record["x_fine"] - found.truth["x"])[at_end])
        separation = found.parameters["capacitance_sensor.separation"]
        end = EPSILON_AREA / (separation + found.truth["x"][-1])
        outside.append(abs(mean) > float(found.calibration.uncertainty(end)))
        assert 140e-6 <= separation <= 160e-6
        assert found.description()["calibration"]["error_95_m"] < 4e-6
    assert sum(outside) <= 4


EPSILON_AREA = 8.854e-12 * 1e-4


def test_the_displacement_is_within_its_stated_error_at_the_stated_rate():
    """95 % intervals, with half a micrometre of error in each setting of the micrometer."""
    rng = np.random.default_rng(5)
    x = np.linspace(0, 70e-6, 29)
    inside = []
    for _ in range(2000):
        separation = 150e-6 + rng.uniform(-10e-6, 10e-6)
        moved = POINTS + 0.5e-6 * rng.standard_normal(len(POINTS))
        found = calibrate(EPSILON_AREA / (separation + moved))
        c = EPSILON_AREA / (separation + x)
        inside.append(np.abs(found.displacement(c) - x) <= found.uncertainty(c))
    assert 0.93 < np.mean(inside) < 0.97


# -- what the thesis saw -----------------------------------------------------------------------


@pytest.mark.ci
def test_a_slowly_loaded_block_breaks_away_near_the_static_friction():
    slow = run_trial("loading-rate/1")
    assert first_peak(slow.truth["friction"]) == pytest.approx(2.35, rel=0.01)
    smooth = np.convolve(slow.record["force"], np.ones(100) / 100, "valid")
    assert smooth.max() == pytest.approx(2.35, abs=0.05)


@pytest.mark.ci
@pytest.mark.parametrize("number", [1, 16])
def test_friction_at_constant_velocity_is_on_the_stribeck_curve(number):
    trial = trials_named("2.3.1")[number - 1]
    found = run_trial(trial)
    steady = found.truth["time"] > 1
    assert np.mean(found.truth["v"][steady]) == pytest.approx(trial.level, rel=2e-3)
    assert np.mean(found.truth["friction"][steady]) == pytest.approx(
        stribeck(trial.level), abs=1e-3
    )
    # the mean of 600 readings; steps of three standard deviations do not average out fully
    assert np.mean(found.record["force"][steady]) == pytest.approx(stribeck(trial.level), abs=0.01)


@pytest.mark.ci
@pytest.mark.parametrize("number", [5, 8, 11])
def test_forces_below_break_away_do_not_move_the_block_for_long(number):
    """Table 2.10 up to 2.2 N either way: there, without overshoot, in about four seconds."""
    trial = trials_named("2.10")[number - 1]
    truth = run_trial(trial).truth
    assert np.abs(truth["x"]).max() < 150e-6
    assert truth["force"][-1] == pytest.approx(trial.level, abs=0.02)
    smooth = np.convolve(truth["force"], np.ones(40) / 40, "valid")
    assert np.abs(smooth).max() < abs(trial.level) + 0.02
    there = np.flatnonzero(np.abs(smooth - trial.level) > 0.02 * abs(trial.level) + 0.01)[-1]
    assert 2 < there * SAMPLE_TIME < 5.5


# -- reproducible, and right -------------------------------------------------------------------


@pytest.mark.ci
def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_record(tmp_path, drawn):
    for folder, seed in (("a", 3), ("b", 3), ("c", 4)):
        RigRecord.of(run_trial("2.8/1", seed=seed)).save(tmp_path / folder)
    for name in ("record.csv", "truth.csv", "trial.json", "record.png"):
        same, again, other = ((tmp_path / f / name).read_bytes() for f in "abc")
        assert same == again
        assert same != other


@pytest.mark.ci
@pytest.mark.parametrize("trial", ["2.4/1", "2.8/3"])
def test_the_truth_converges_with_the_tolerance_and_is_converged_at_the_default(trial):
    sharp = run_trial(trial, tolerance=1e-11).truth
    found = {tolerance: run_trial(trial, tolerance=tolerance).truth for tolerance in (1e-4, 1e-8)}
    coarse, fine = (np.abs(truth["x"] - sharp["x"]).max() for truth in found.values())
    assert fine < 0.1 * coarse
    default = run_trial(trial).truth
    assert np.abs(default["x"] - sharp["x"]).max() < 1e-9
    assert np.abs(default["friction"] - sharp["friction"]).max() < 1e-5
