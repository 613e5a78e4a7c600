"""The trials are those of the thesis' tables, by every name that a user may give them."""

import numpy as np
import pytest

from ballscrew.measurement.rig.trials import TABLES, trials_named

STEPS = [0.3, 0.6, 1.0, 1.5, 1.8, 2.0, 2.1, 2.2, -0.3, -0.6, -2.1, -2.3, -2.4]  # N
COUNTS = {"2.2": 13, "2.3.1": 16, "2.4": 16, "2.6": 9, "2.8": 6, "2.10": 13, "2.11": 1}
SERIES = {"viscous": 60, "loading-rate": 20, "presliding": 1}


def levels(table):
    return [t.level for t in trials_named(table)]


def test_tables_have_their_numbers_of_trials_and_their_levels():
    assert {table: len(trials_named(table)) for table in TABLES} == COUNTS | SERIES
    assert levels("2.2") == levels("2.10") == STEPS
    assert levels("2.8") == [0.5, 0.5, 1.0, 1.0, 1.5, 1.5]
    for trial in trials_named("2.8"):
        assert trial.fine
        np.testing.assert_array_equal(trial.reference(), trial.level)
    assert sorted(levels("2.3.1"))[:2] == [-5.5e-3, -5e-3]
    assert min(abs(v) for v in levels("2.3.1")) == 2e-3
    assert sorted({abs(v) for v in levels("viscous")}) == [3e-3, 4e-3, 5e-3, 6e-3, 7e-3, 8e-3]


@pytest.mark.parametrize(
    ("name", "duration", "mean", "swing", "omega"),
    [
        ("2.4/7", 19.0, 0.0, 1e-3, 1 / 6),
        ("2.4/15", 19.0, 0.0, -1e-3, 1 / 6),
        ("2.6/6", 18.85, 0.0, 5e-3, 2 / 3),
        ("2.11", 18.85, 1.5e-3, 1e-3, 3.0),
    ],
)
def test_sines_are_those_of_the_tables(name, duration, mean, swing, omega):
    (trial,) = trials_named(name)
    expected = mean + swing * np.sin(omega * trial.time)
    np.testing.assert_allclose(trial.reference(), expected, atol=1e-18)
    assert trial.duration == duration
    assert trial.time[-1] == pytest.approx(duration)


def test_the_staircase_rises_by_a_quarter_newton_a_second_and_holds():
    (trial,) = trials_named("presliding")
    at = np.searchsorted(trial.time, [1.0, 3.0, 5.5, 8.0, 17.0])
    np.testing.assert_allclose(trial.reference()[at], [0.0, 0.25, 0.5, 0.75, 1.5], atol=2e-3)


@pytest.mark.parametrize("name", ["2.4/7", "table-2.4-7", "2.4-07"])
def test_a_trial_answers_to_all_its_names(name):
    assert [t.name for t in trials_named(name)] == ["2.4/7"]
