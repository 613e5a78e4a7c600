"""Rounding of an encoder at a constant speed beats with the samples, and is no cause."""

import json

import numpy as np
import pytest
from diagnosed import nominal, run

from ballscrew.measurement.diagnosis.causes.travel import Beats
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.records.reading import check_record

STEP, COUNT = 5e-3, 2e-6


def course(speed, count=COUNT):
    time = STEP * np.arange(2000)
    x = np.round(speed * time / count) * count
    return lay_along(check_record("made", {"time": time, "u": 0 * time + 1.0, "x": x}), nominal())


@pytest.mark.ci
@pytest.mark.parametrize("speed", [0.00213, -0.0069713])
def test_the_strongest_line_of_what_is_rounded_away_is_one_of_its_beats(speed):
    """By the spectrum of the rounding itself, as a sample and as the mean of a window tell it."""
    made = course(speed)
    beats = Beats.of(made)
    away = made.record.x - speed * made.time
    for width in (1, made.width):
        told = away[: len(away) // width * width].reshape(-1, width).mean(axis=1)
        power = np.abs(np.fft.rfft((told - told.mean()) * np.hanning(len(told))))
        swing = np.argmax(power) / (len(told) * width * abs(speed) * STEP)
        assert beats.have(swing, 2.0 / np.ptp(made.x))


@pytest.mark.ci
@pytest.mark.parametrize(("trial", "seed"), [("2.3.1/8", 1), ("viscous/44", 12)])
def test_a_trial_of_the_rig_at_constant_speed_has_no_ripple(tmp_path, trial, seed):
    assert run("rig", trial, "--seed", seed, "--out", tmp_path / "trial")[0] == 0
    given = (tmp_path / "trial" / "record.csv", "--params", tmp_path / "trial" / "parameters.toml")
    _, printed, _ = run("diagnose", *given, "--json", "--out", tmp_path / "out")
    told = json.loads(printed)
    assert (told["verdict"], told["causes"]) == ("undecided", [])  # of an asymmetry
