"""What noise alone leaves, and the one comparison with it that clears a model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal
from hypothesis import given
from hypothesis import strategies as st
from worlds import layout as at

from ballscrew.diagnosis.balance import Added
from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import Drive
from ballscrew.diagnosis.modelled_record import lay_along
from ballscrew.diagnosis.noise_floor import NoiseFloor
from ballscrew.diagnosis.residuals import Residual, floor, residual, rms
from ballscrew.records.bad_record import BadRecord
from ballscrew.records.reading import check_record

RANDOM = np.random.default_rng(5)


def left(force, between):
    n = len(force)
    return Residual(force, between, np.zeros(n), np.ones(n, dtype=bool))


@given(sizes=st.tuples(*[st.floats(1e-6, 1e6)] * 4))
def test_at_most_twice_the_floor_in_newtons_is_noise_and_more_is_not(sizes):
    force, between, of_force, of_between = sizes
    noise = NoiseFloor(of_force, of_between, 0.0, False)
    signal = np.array([1.0, -1.0, 1.0, -1.0])
    told = noise.has(left(force * signal, between * signal))
    assert told == (force <= 2.0 * of_force and between <= 2.0 * of_between)


def test_no_variance_of_the_laws_force_is_below_nothing():
    """Where the law is the same at all speeds, only reversals make any."""
    values = {"m": 95.1, "gain": 35.2, "offset": -3.2, "sigma2": 203.5, "Fc": 20.4, "Fs": 20.4}
    model = Drive("drive", "classical", values | {"Vs": 1.0})
    time = 1e-3 * np.arange(6000)
    x = 0.01 * np.abs(time % 2 - 1) + 1e-7 * np.random.default_rng(0).standard_normal(6000)
    record = check_record("made", {"time": time, "u": np.sin(time), "x": x})
    assert lay_along(record, model).force_variance.min() >= 0.0


@pytest.mark.parametrize("count", [2e-6, 5e-7])
def test_reading_anew_changes_as_much_as_rounding_leaves_under_the_true_model(count):
    record = strong_record({}, samples=4_000)
    signals = record.signals | {"x": count * np.round(record.x / count)}
    courses = [lay_along(check_record("counted", signals), nominal())]
    found = residual(courses, nominal(), Added.nothing(courses))
    law = np.mean(np.concatenate([c.force_variance for c in courses]))
    known = math.hypot(floor(courses, nominal()).force_rms, math.sqrt(law))
    assert 0.5 < found.force_rms / known < 2.0


def test_a_force_of_so_many_newtons_is_left_as_so_many_whatever_the_models_mass():
    """A heavier model answers a force less; what is left is told in newtons all the same."""
    record = strong_record({at.LOAD: 0.4}, samples=4_000)
    light, heavy = nominal(), nominal().changed({"m": 3.0 * nominal().values["m"]})
    course = [lay_along(record, light)]
    means = []
    for model in (light, heavy):
        found = residual(course, model, Added.nothing(course))
        means.append(float(np.mean(found.force[found.telling])))
    assert means[0] == pytest.approx(means[1], rel=0.06)
    assert abs(means[0]) == pytest.approx(0.4, rel=0.1)


STEP = 1e-5  # m


def jumped():
    record = strong_record({}, samples=6_000)
    late = record.time > record.time[3_000]
    return record.signals | {"x": record.x + STEP * late}, {"Fc": 2.0}


def random_walk():
    record = strong_record({}, samples=6_000)
    return record.signals | {"x": 1e-4 * np.cumsum(RANDOM.standard_normal(6_000))}, {}


@pytest.mark.parametrize("made", [jumped, random_walk])
def test_a_wrong_model_is_not_cleared_where_x_jumps_or_moves_at_random(made):
    signals, wrong = made()
    model = nominal()
    model = model.changed({n: f * model.values[n] for n, f in wrong.items()})
    found = diagnose_records([check_record("made", signals)], model)
    assert found.verdict != "none"


@pytest.mark.parametrize(
    "x",
    [
        1e-2 * RANDOM.standard_normal(6_000),
        1e-2 * np.sign(np.sin(0.01 * np.arange(6_000) + 0.1)),
        1e-5 * np.sign(np.sin(0.01 * np.arange(6_000) + 0.1)),
    ],
    ids=["noise", "squares", "small squares"],
)
def test_a_position_that_shows_no_motion_is_refused(x):
    signals = strong_record({}, samples=6_000).signals | {"x": x}
    with pytest.raises(BadRecord, match=r"parts of .* samples are in motion; expected 50 at least"):
        diagnose_records([check_record("made", signals)], nominal())


def test_voltage_and_current_that_contradict_each_other_are_not_cleared():
    record = strong_record({}, with_current=True, samples=4_000)
    courses = [lay_along(record, nominal())]
    right = residual(courses, nominal(), Added.nothing(courses))
    signals = record.signals | {"i": 2.0 * record.signals["i"]}
    courses = [lay_along(check_record("twice", signals), nominal())]
    twice = residual(courses, nominal(), Added.nothing(courses))
    assert twice.by_current_rms > 20.0 * right.by_current_rms
    force = nominal().per_ampere * rms(record.signals["i"])
    assert twice.by_current_rms == pytest.approx(force, rel=0.1)
